"""The page of a study:  its table -> report.html and its figures; the same table gives the same bytes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial

from fopi_tune.core.text_tables.words import counted
from fopi_tune.report.figures.picture import Picture
from fopi_tune.report.figures.studies import CellColumns, chosen_heat_maps, figures_of
from fopi_tune.report.page import figure_files, render_figures, render_template
from fopi_tune.report.text.formatting import number
from fopi_tune.report.text.study import best_sentence
from fopi_tune.study import StudyResult
from fopi_tune.study.model import HeatMap, ReportRule, Study, Value
from fopi_tune.study.table import override_columns

#: the page's file
STUDY_REPORT = "report.html"
#: rows of the page's table, and axes of the figure that is chosen
_MOST_ROWS, _MOST_AXES = 500, 10


def study_page_files(result: StudyResult) -> dict[str, str | bytes]:
    """The page and its figures, by their names in the folder of the study.

    Args:
        result: the end of a study.

    Returns:
        Figures as text (SVG) and bytes (PNG), `report.html` last; empty where there are less than two cells of specs,
        or nothing differs and no figure is asked for.
    """
    cells = CellColumns(result.table)
    pictures = figures_of(cells, *_chosen(result.study, cells))
    asked = result.study.report != ReportRule()
    if len(cells.rows) < 2 or not (pictures or asked):
        return {}
    figures = list(render_figures({name: partial(_kept, each) for name, each in pictures.items()}, None))
    columns = [name for name in result.table.columns if any(value is not None for value in cells.values(name))]
    values = {
        "name": result.study.name,
        "description": result.study.description,
        "outcomes": _counted(cells.values("outcome")),
        "good": not result.counts.failed and not result.table.undecided,
        "best": best_sentence(result),
        "undrawn": _undrawn(result.study, cells),
        "figures": figures,
        "columns": [(name, cells.is_numeric(name)) for name in columns],
        "rows": [[_cell_text(row.get(name)) for name in columns] for row in cells.rows[:_MOST_ROWS]],
        "more": max(0, len(cells.rows) - _MOST_ROWS),
    }
    return {**figure_files(figures), STUDY_REPORT: render_template("study.html.jinja", values)}


def _kept(picture: Picture, _: None) -> Picture:
    return picture


def _chosen(study: Study, cells: CellColumns) -> tuple[Sequence[HeatMap], Sequence[str]]:
    """The figures that the study asks for; where it does not, those of what varies."""
    overrides = dict.fromkeys(name for cell in study.cells for name in override_columns(cell))
    axes = [name for name in overrides if cells.varies(name)]
    collected = [*([study.best.column] if study.best else []), *(column.name for column in study.collect)]
    results = [name for name in dict.fromkeys(collected) if cells.varies(name) and cells.is_numeric(name)]
    results = [name for name in results if name not in axes]
    rule = study.report
    maps = chosen_heat_maps(axes, results) if rule.heat_maps is None else rule.heat_maps
    parallel = [*axes, *results][:_MOST_AXES] if rule.parallel_coordinates is None else rule.parallel_coordinates
    return maps, parallel


def _undrawn(study: Study, cells: CellColumns) -> list[str]:
    """Sentences about figures that are asked for and have nothing to show."""
    maps = study.report.heat_maps or ()
    found = [each.column for each in maps if not any(isinstance(v, int | float) for v in cells.values(each.column))]
    return [f"No heat map of {name}: no cell has a number there." for name in found]


def _counted(outcomes: Sequence[Value]) -> str:
    counts = Counter(str(outcome) for outcome in outcomes)
    return f"{counted(len(outcomes), 'cell')}: {', '.join(f'{count} {name}' for name, count in counts.items())}"


def _cell_text(value: Value) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return number(value) if isinstance(value, float) else str(value)
