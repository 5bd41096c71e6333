"""Options of trials: the protocol and its limit of force."""

from __future__ import annotations

import argparse

import pytest

from graspcast.cli.protocol_options import add_protocol, settings_of
from graspcast.errors import InputError
from graspcast.simulation.grippers import FrankaHand
from graspcast.simulation.trial.settings import TrialSettings


def parsed(*arguments: str) -> argparse.Namespace:
    verb = argparse.ArgumentParser()
    add_protocol(verb)
    return verb.parse_args(arguments)


def test_options_choose_the_settings_of_trials() -> None:
    hand = FrankaHand()
    assert settings_of(parsed(), hand) == TrialSettings()
    assert settings_of(parsed("--protocol", "paper"), hand) == TrialSettings.paper()
    assert settings_of(parsed("--contact-force", "12.5"), hand).contact_force_n == 12.5
    verb = argparse.ArgumentParser()
    add_protocol(verb)
    assert f"or {TrialSettings().contact_force_n:g})" in " ".join(verb.format_help().split())
    with pytest.raises(InputError, match="--protocol robot"):
        settings_of(parsed("--protocol", "paper", "--contact-force", "9"), hand)
