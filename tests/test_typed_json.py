"""Records as JSON and back, with the keys of one among those of another, and with alternatives."""

from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nas_data.typed_json import FormError, LacksKeys, as_object, from_json

INLINE = {"inline": True}


@dataclass(frozen=True)
class Failure:
    reason: str


@dataclass(frozen=True)
class Success:
    score: float
    places: tuple[tuple[str, int | None], ...] = ()


@dataclass(frozen=True)
class Outcome:
    name: str
    found: Failure | Success = field(metadata=INLINE)
    code: str | None = field(default=None, metadata={"optional": True})
    others: dict[str, Failure | Success] = field(default_factory=dict)


found = st.builds(Failure, st.text()) | st.builds(
    Success, st.floats(allow_nan=False), st.lists(st.tuples(st.text(), st.none() | st.integers())).map(tuple)
)


@given(st.builds(Outcome, st.text(), found, st.none() | st.text(), st.dictionaries(st.text(), found)))
def test_a_record_reads_back_as_it_was_written(record):
    assert from_json(Outcome, as_object(record)) == record


def test_the_keys_of_an_inline_record_stand_beside_the_others():
    assert as_object(Outcome("a", Success(0.5))) == {"name": "a", "score": 0.5, "places": [], "others": {}}


def test_a_record_that_is_none_of_the_alternatives_lacks_keys():
    with pytest.raises(LacksKeys, match="it lacks score"):
        from_json(Outcome, {"name": "a"})
    with pytest.raises(FormError, match=r"others\.b\.score is 'much', not a number"):
        from_json(Outcome, {"name": "a", "score": 1, "others": {"b": {"score": "much"}}})
