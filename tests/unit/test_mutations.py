"""The texts that ``python -m tests.benchmarks.mutations`` changes still stand where it looks, and so do its tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.benchmarks.mutations import MUTATIONS, Mutation


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda mutation: mutation.what)
def test_a_mutation_changes_one_place_and_names_a_test(project_root: Path, mutation: Mutation) -> None:
    text = (project_root / "pmsm_ctrl" / mutation.file).read_text(encoding="utf-8")
    assert text.count(mutation.old) == 1, "change the text in tests/benchmarks/mutations.py with the code"
    path, _, chosen = mutation.tests.partition(" -k ")
    place = project_root / "tests" / path
    assert place.exists()
    assert not chosen or chosen in place.read_text(encoding="utf-8"), "no test of this name"
