"""``ospc compare``: two calibrations side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from ospc.evaluation.comparison import Comparison

_ROWS = {
    "response_rmse": "response, RMSE of g",
    "response_shape_rmse": "response shape, RMSE of s·g over greys 5…250",
    "log_ratio_error": "log-ratio error κ",
    "vignette_rmse": "vignette, RMSE of the radial profile",
    "vignette_pixel_rmse": "vignette, RMSE over all pixels",
}
_FREEDOMS = (
    "Scale is free, because it cannot be observed: g(0) = 0, g(255) = 1, V = 1 at the centre; "
    "the shape is compared after the best scale s."
)


@click.command("compare")
@click.argument("a")
@click.argument("b")
@click.option("--gamma", is_flag=True, help="Add the figures after the best common exponent γ: g^γ and V^γ.")
@click.option("--plot", type=click.Path(path_type=Path), help="Draw both into this file.")
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
def command(a: str, b: str, gamma: bool, plot: Path | None, as_json: bool) -> None:
    """Compare calibration A with B, which is taken as the truth.

    Each is a calibration.json, a pcalib.txt, a vignette.png, a pair 'pcalib.txt,vignette.png', a folder with them, or
    a file of hugin (.pto), Adobe (.lcp), lensfun (.xml) or OpenCV (.yml). A file that does not state the image size
    takes it from the other one.
    """
    from ospc.evaluation.comparison import aligning_exponent, compare
    from ospc.formats.opening import open_both

    first, second = open_both(a, b)
    results = [compare(first, second)]
    if gamma:
        results.append(compare(first, second, aligning_exponent(first, second)))
    if plot is not None:
        from ospc.report.comparison import plot_photometries

        plot_photometries([first, second], plot)
    if as_json:
        _print_json(a, b, results)
    else:
        _print_table(a, b, results)
        if plot is not None:
            click.echo(f"plot: {plot}")


def _print_json(a: str, b: str, results: list[Comparison]) -> None:
    import json

    content = {"a": a, "b": b, "freedoms": _FREEDOMS, "unaligned": _figures(results[0])}
    if len(results) > 1:
        content["gamma_aligned"] = _figures(results[1])
    click.echo(json.dumps(content, indent=1))


def _figures(result: Comparison) -> dict[str, object]:
    figures: dict[str, object] = {"exponent": result.exponent} | {name: getattr(result, name) for name in _ROWS}
    if result.response_coverage is not None:
        figures["response_coverage"] = result.response_coverage._asdict()
    return figures


def _print_table(a: str, b: str, results: list[Comparison]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table()
    table.add_column("")
    table.add_column("unaligned", justify="right")
    if len(results) > 1:
        table.add_column(f"after γ = {results[1].exponent:.4f}", justify="right")
    for name, label in _ROWS.items():
        figures = [getattr(result, name) for result in results]
        if figures[0] is not None:
            table.add_row(label, *(f"{figure:.4f}" for figure in figures))
    share = results[0].response_coverage
    if share is not None:
        shares = f"{share.within_1_sigma:.0%} / {share.within_2_sigma:.0%}"
        table.add_row("response within ±1σ / ±2σ", shares, *[""] * (len(results) - 1))
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"{a}  against  {b}", markup=False)
    console.print(table)
    console.print(_FREEDOMS)
    if len(results) > 1:
        console.print("The second column raises response and vignette of the first to one common exponent.")
