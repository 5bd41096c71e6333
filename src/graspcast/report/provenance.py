"""What was judged, and by what: files with digests, estimators, models, certificates, trials."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from graspcast.errors import GraspcastError
from graspcast.forecasting.model_card import ModelCard
from graspcast.guarantees.certificate import Certificate
from graspcast.io.hashing import sha256_of_file
from graspcast.io.provenance import versions
from graspcast.report.content import Cell, Section, Table
from graspcast.report.rates import DRAWS
from graspcast.report.run_data import RunData
from graspcast.report.text import clean

__all__ = ["provenance_section"]

_SHOWN = 16
_MOST = 6


def provenance_section(run: RunData) -> Section:
    """Return the section of what was judged, and by what."""
    tables = [
        *(_model(run, path, card) for path, card in run.cards.items()),
        _certificates(run),
        _trials(run),
        _estimators(run),
        _files(run),
        _software(),
    ]
    return Section(
        key="provenance",
        title="What was judged, and by what",
        tables=tuple(table for table in tables if table is not None),
        code=clean(run.commands.strip()),
    )


def _pairs(key: str, caption: str, pairs: list[tuple[str, object]]) -> Table:
    rows = tuple((Cell.of(name), Cell.of(value)) for name, value in pairs)
    return Table(key, caption, ("what", "value"), rows, (False, False))


def _model(run: RunData, path: Path, card: ModelCard) -> Table:
    settings = ", ".join(f"{name} {value}" for name, value in sorted(card.settings.items()))
    views = ", ".join(f"{name} {value:g}" for name, value in sorted(card.views.items()))
    pairs: list[tuple[str, object]] = [
        ("principal", card.principal),
        ("supporters", ", ".join(card.supporters) or "none"),
        ("gripper", card.gripper),
        ("objects", ", ".join(card.objects)),
        ("method", f"{card.method}, features {card.features}"),
        ("settings, with seed", settings or "none"),
        ("trained on several views", views or "no"),
        ("training outcomes", f"{card.samples:,}, of which {card.success_rate:.3f} succeed"),
        ("training scenes", _listed(card.scenes)),
        ("objects learned from simulation alone", ", ".join(card.simulated) or "none"),
        ("warnings", "; ".join(card.warnings) or "none"),
        ("SHA-256 of the training data", card.data),
        ("digest of the model", card.digest),
        ("versions", ", ".join(f"{name} {v}" for name, v in card.versions.items())),
    ]
    number = list(run.cards).index(path) + 1
    return _pairs(f"model-{number}", f"The model card of {run.files.shown(path)}.", pairs)


def _listed(names: tuple[str, ...]) -> str:
    ordered = sorted(names, key=lambda name: (len(name), name))
    more = f" and {len(ordered) - _MOST} more" if len(ordered) > _MOST else ""
    return ", ".join(ordered[:_MOST]) + more or "not stated"


def _certificates(run: RunData) -> Table | None:
    digests = {card.digest for card in run.cards.values()}
    rows = [
        (
            Cell.of(run.files.shown(path)),
            Cell.of(guarantee.scope),
            Cell.of(guarantee.rate, 3),
            Cell.of(guarantee.confidence, 3),
            Cell.of(guarantee.threshold),
            Cell.of(guarantee.units),
            Cell.of(guarantee.trials),
            Cell.of(guarantee.attempt_rate),
            Cell.of(_belongs(certificate, digests)),
        )
        for path, certificate in run.certificates.items()
        for guarantee in certificate.guarantees
    ]
    if not rows:
        return None
    return Table(
        key="certificates",
        caption="Certificates: attempts at the threshold or above it succeed at the rate or above "
        "it, with the confidence. A dash: no threshold could be certified.",
        columns=(
            *("certificate", "scope", "rate", "confidence", "threshold", "units", "trials"),
            *("attempted", "of the model above"),
        ),
        rows=tuple(rows),
        numeric=(False, False, *(True for _ in range(6)), False),
    )


def _belongs(certificate: Certificate, digests: set[str]) -> str:
    if not digests:
        return "not known"
    return "yes" if certificate.provenance.get("model") in digests else "no, of another model"


def _trials(run: RunData) -> Table | None:
    rows = []
    for one in run.trials:
        configuration = one.manifest.get("configuration", {})
        sources = ", ".join(f"{name}: {file}" for name, file in one.sources.items())
        rows.append(
            (
                Cell.of(run.files.shown(one.path)),
                Cell.of(len(one.table)),
                Cell.of(", ".join(sorted(one.table["gripper"].unique()))),
                Cell.of(one.protocol or "not stated"),
                Cell.of(sources or "not stated"),
                Cell.of(configuration.get("graspcast", "not stated")),
                Cell.of(configuration.get("mujoco", "not stated")),
                Cell.of(str(one.manifest.get("hash", "none"))[:_SHOWN]),
            )
        )
    if not rows:
        return None
    return Table(
        key="trials",
        caption="Trials: their protocol, the results files that guided them, and the configuration "
        "of the campaign.",
        columns=(
            *("trials from", "trials", "gripper", "protocol", "guided by"),
            *("graspcast", "MuJoCo", "configuration"),
        ),
        rows=tuple(rows),
        numeric=(False, True, *(False for _ in range(6))),
    )


def _estimators(run: RunData) -> Table | None:
    rows = []
    for of, tables in run.results.items():
        for name, table in tables.items():
            images = set(zip(table.scene_id.tolist(), table.im_id.tolist(), strict=True))
            rows.append(
                (
                    *(Cell.of(name), Cell.of(of), Cell.of(run.files.shown(table.source))),
                    *(Cell.of(len(table)), Cell.of(len(images))),
                    Cell.of(len(set(table.scene_id.tolist()))),
                )
            )
    if not rows:
        return None
    return Table(
        key="estimates",
        caption="The estimators and their results.",
        columns=("estimator", "dataset", "file", "estimates", "images", "scenes"),
        rows=tuple(rows),
        numeric=(False, False, False, True, True, True),
    )


def _files(run: RunData) -> Table:
    rows = []
    for kind, path in _all_files(run):
        try:
            digest, size = sha256_of_file(path), path.stat().st_size
        except (GraspcastError, OSError):
            continue
        rows.append((kind, run.files.shown(path), size, digest))
    return Table(
        key="files",
        caption="The files, and the first digits of the SHA-256 of their bytes; the CSV has all.",
        columns=("what", "file", "bytes", "SHA-256"),
        rows=tuple(
            (Cell.of(kind), Cell.of(name), Cell.of(size), Cell.of(digest[:_SHOWN]))
            for kind, name, size, digest in rows
        ),
        numeric=(False, False, True, False),
        data=(("what", "file", "bytes", "sha256"), tuple(rows)),
    )


def _all_files(run: RunData) -> Iterator[tuple[str, Path]]:
    files = run.files
    for kind, paths in (
        ("verdicts", files.verdicts),
        ("verdicts after each look", files.stages),
        ("model", files.models),
        ("certificate", files.certificates),
        ("tolerance", files.tolerances),
        ("estimates", tuple(path for _, path in files.estimates)),
    ):
        yield from ((kind, path) for path in paths)
    for path in files.outcomes:
        whole = path / "outcomes.parquet"
        yield "outcomes", whole if whole.is_file() else path


def _software() -> Table:
    pairs: list[tuple[str, object]] = [*versions().items()]
    pairs.append(("intervals", f"95 %, {DRAWS:,} draws of scenes, seed 0"))
    return _pairs("software", "What this report was made by.", pairs)
