"""What is counted of photographs in rain and of dry ones."""

import pandas as pd
import pytest

from benchmarks.real_rain import COLUMNS, summary


@pytest.mark.parametrize(("wet", "more"), [([0.3, 0.4], 1.0), ([0.1, 0.2], 0.5), ([0.0, 0.0], 0.0)])
def test_how_often_the_first_kind_has_more(wet, more):
    """By hand: each of one kind against each of the other, equal ones counting half."""
    rows = [("rainy", value) for value in wet] + [("dry", value) for value in (0.1, 0.2)]
    photographs = pd.DataFrame([(kind, *([value] * len(COLUMNS))) for kind, value in rows], columns=["kind", *COLUMNS])
    table = summary(photographs, ("rainy", "dry"))
    assert table["of a photograph"].tolist() == list(COLUMNS)
    assert table["more in the first"].tolist() == [more] * len(COLUMNS)
    assert table["rainy, median"].tolist() == pytest.approx([sum(wet) / 2] * len(COLUMNS))
