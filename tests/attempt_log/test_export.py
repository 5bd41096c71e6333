import numpy as np
import polars as pl

from graspcast.attempt_log.export import exported


def test_matrices_become_numbers_that_round_nothing():
    values = np.random.default_rng(0).normal(size=(3, 3))
    table = pl.DataFrame({"K": [values.tobytes(), None]}, schema={"K": pl.Binary})
    nested = exported(table, nested=True)
    np.testing.assert_array_equal(nested["K"][0].to_numpy().reshape(3, 3), values)
    words = exported(table, nested=False)["K"]
    np.testing.assert_array_equal([float(x) for x in words[0].split()], values.ravel())
    assert words[1] is None
    assert exported(table.clear(), nested=True).schema == {"K": pl.List(pl.Float64)}
