"""The figures of docs/explanation are those that the code draws."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.explanation_figures import FIGURES

DOCS = Path(__file__).parents[2] / "docs"


def test_every_figure_of_an_explanation_is_drawn_by_the_code_and_every_drawn_one_is_shown():
    pages = "".join(path.read_text(encoding="utf-8") for path in (DOCS / "explanation").glob("*.md"))
    assert set(re.findall(r"pictures/explanation-([a-z]+)\.png", pages)) == set(FIGURES)
    assert all((DOCS / "pictures" / f"explanation-{name}.png").is_file() for name in FIGURES)


@pytest.mark.slow
@pytest.mark.parametrize("name", FIGURES)
def test_each_figure_has_curves_with_labelled_axes(name):
    for axes in FIGURES[name]().axes:
        assert axes.get_xlabel() and axes.get_ylabel() and axes.lines


def test_the_modulation_of_the_figure_has_the_sidebands_of_the_text():
    _, spectrum = FIGURES["modulation"]().axes
    heights = [float(text.get_text().split(": ")[1]) for text in spectrum.texts]
    assert heights == [1.0, 0.15, 0.15]  # D² = 2·(0.15² + 0.15²) = 0.3²
