"""Counts and their nouns."""

import re
from pathlib import Path

import pytest

import nas_data
from nas_data.count_of import count_of

PACKAGE = Path(nas_data.__file__).parent


@pytest.mark.parametrize(("count", "words"), [(0, "0 rows"), (1, "1 row"), (2, "2 rows"), (1200, "1,200 rows")])
def test_one_is_singular(count, words):
    assert count_of(count, "row", ",") == words
    assert count_of(count, "policy", ",", plural="policies") == words.replace("rows", "policies").replace(
        "row", "policy"
    )


def test_no_message_makes_a_plural_of_its_own():
    own = re.compile(r"\} [a-z]+(?:\(s\)|\{'s?' (?:\*|if))")
    found = [path for path in PACKAGE.rglob("*.py") if own.search(path.read_text(encoding="utf-8"))]
    assert found == []
