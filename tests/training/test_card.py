"""The model card says what the weights are for, and how good they are."""

from __future__ import annotations

from graspcast.perception.network import Network
from graspcast.training.card import card


def test_the_card_of_the_shipped_weights() -> None:
    text = card(Network("dense"), "dense")
    assert text.startswith("# Weights of the estimator dense for ycbv\n")
    assert "| ycbv-3 " in text and "199 mm" in text
    assert "Trained for 7000 steps" in text
    assert "Errors on 300 rendered images" in text and "| all " in text
