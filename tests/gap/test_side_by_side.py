"""Work side by side: the same results in the same order."""

import numpy as np
import pytest
from support.evidence_samples import commanded

from nas_data.effects.base import parse
from nas_data.gap import side_by_side as module
from nas_data.gap.nominal import Nominal
from nas_data.gap.side_by_side import is_sharing_cores, map_in_parallel


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "count_cores", lambda: 2)


def test_results_keep_their_order_and_work_spreads_once():
    seen = map_in_parallel(
        lambda item: (item, is_sharing_cores(), map_in_parallel(lambda inner: inner + item, [1, 2])), range(9)
    )
    assert [item for item, _, _ in seen] == list(range(9))
    assert all(shares for _, shares, _ in seen)
    assert [inner for _, _, inner in seen] == [[1 + item, 2 + item] for item in range(9)]
    assert not is_sharing_cores()


def test_an_error_reaches_the_caller():
    def fail(item: int) -> int:
        raise ValueError(f"item {item}")

    with pytest.raises(ValueError, match="item 0"):
        map_in_parallel(fail, range(3))


def test_rollouts_are_the_same_to_the_bit():
    evidence = commanded()
    nominal = Nominal.load("ergojr", evidence)
    effects = [parse(f"coulomb_friction:joint=m{joint},torque=0.02") for joint in (2, 3, 4, 5)]
    together = map_in_parallel(lambda effect: nominal.predict(evidence, [effect]), effects)
    assert all(
        np.array_equal(nominal.predict(evidence, [effect]), found)
        for effect, found in zip(effects, together, strict=True)
    )
