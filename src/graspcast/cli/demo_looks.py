"""The demonstration's files, its table of what looking again is worth, and its main picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspcast.cli.console import print_text
from graspcast.cli.score import print_policies

if TYPE_CHECKING:
    import polars as pl

    from graspcast.bop.dataset import BopDataset
    from graspcast.evaluation.look_scores import Stage

__all__ = ["LOOKS", "DemoFiles", "print_looks", "save_two_sides", "some_images", "told_instance"]

LOOKS = 3
"""At most so many looks."""
_IMAGES = 2
_SEED = 0


@dataclass(frozen=True)
class DemoFiles:
    """What the demonstration writes, and where.

    Attributes
    ----------
    out
        The directory.
    dataset
        The dataset's name.
    """

    out: Path
    dataset: str

    @property
    def model(self) -> Path:
        """The forecaster."""
        return self.out / "model.npz"

    @property
    def commands(self) -> Path:
        """The commands that made it all."""
        return self.out / "commands.sh"

    @property
    def report(self) -> Path:
        """The report."""
        return self.out / "report.html"

    def poses(self, estimator: str) -> Path:
        """Return an estimator's results."""
        return self.out / f"{estimator}_{self.dataset}-test.csv"

    def fused(self, looks: int) -> Path:
        """Return the poses fused from up to so many looks."""
        return self.poses(f"fused{looks}")

    def trials(self, looks: int) -> Path:
        """Return the trials of the principal (one look), or of fused poses."""
        return self.out / ("trials" if looks == 1 else f"trials_fused{looks}")

    def verdicts(self, looks: int) -> Path:
        """Return the verdicts after up to so many looks."""
        return self.out / f"verdicts{looks}.csv"


def print_looks(files: DemoFiles, principal: str) -> None:
    """Print what verdicts and further looks are worth, on tables that training has not seen."""
    from graspcast.evaluation.look_scores import score_looks

    found = score_looks([_stage(files, looks) for looks in range(1, LOOKS + 1)])
    title = (
        f"{found.n} grasps in {found.scenes} scenes, 95 % intervals over scenes; one look: "
        f"guided by {principal}, several: by the fused pose"
    )
    print_text("\n# What following the verdicts and looking again is worth")
    print_policies(found, title)


def _stage(files: DemoFiles, looks: int) -> Stage:
    from graspcast.estimates.outcomes import read_all_outcomes
    from graspcast.evaluation.look_scores import Stage
    from graspcast.forecasting.verdict_file import read_verdicts

    # Where there is one view only, the principal guides after several looks too.
    trials = sorted({files.trials(1), files.trials(looks)})
    return Stage(read_verdicts(files.verdicts(looks)), read_all_outcomes(trials))


def _seen(files: DemoFiles, looks: int) -> pl.DataFrame:
    """Return verdicts with outcomes, in an order drawn at random from a seed."""
    from graspcast.estimates.outcomes import TRIAL_COLUMNS
    from graspcast.evaluation.verdict_scores import with_outcomes

    stage = _stage(files, looks)
    ordered = with_outcomes(stage.verdicts, stage.outcomes).sort(*TRIAL_COLUMNS)
    return ordered.sample(fraction=1.0, shuffle=True, seed=_SEED)


def some_images(files: DemoFiles) -> list[str]:
    """Return the first images in which one grasp is attempted and another one is not."""
    import polars as pl

    seen = _seen(files, 1)
    mixed = seen.filter(pl.col("attempt").n_unique().over("scene_id", "im_id") > 1)
    images = (mixed if len(mixed) else seen).unique(["scene_id", "im_id"], maintain_order=True)
    return [f"{s}/{i}" for s, i in images.select("scene_id", "im_id").head(_IMAGES).iter_rows()]


def told_instance(files: DemoFiles) -> dict[str, Any] | None:
    """Return an instance whose grasp fails after one look, and is attempted and holds after all.

    Of these it is the one that was most probable after one look; None if there is none.
    """
    import polars as pl

    place = ["scene_id", "im_id", "obj_id"]
    one, every = _seen(files, 1), _seen(files, LOOKS)
    one = one.filter(attempt=False, success=0).drop_nulls("probability")
    every = every.filter(pl.col("attempt"), success=1, estimator="fused")
    every = every.select(*place, fused_est_id="est_id")
    both = one.unique(place, keep="none").join(every.unique(place, keep="none"), on=place)
    both = both.sort("probability", *place, descending=[True, False, False, False])
    return both.row(0, named=True) if len(both) else None


def save_two_sides(files: DemoFiles, dataset: BopDataset, principal: str) -> Path | None:
    """Draw the instance of :func:`told_instance` from two sides; None if there is none."""
    from graspcast.bop.results import read_results
    from graspcast.perception import BUILT_IN
    from graspcast.rendering.drawing import save_png
    from graspcast.rendering.fused_sides import draw_fused

    row = told_instance(files)
    if row is None:
        return None
    results = {name: read_results(files.poses(name)) for name in BUILT_IN}
    where = int(row["scene_id"]), int(row["im_id"]), int(row["obj_id"])
    sheet = draw_fused(dataset, results, *where, principal=principal, max_views=LOOKS)
    if sheet is None:
        return None
    save_png(path := files.out / "two-sides.png", sheet)
    return path
