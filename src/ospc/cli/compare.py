"""``ospc compare``: compare two calibrations."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ospc.cli.options import AS_JSON, PLOT, argument, declared, option
from ospc.cli.terminal import console, print_json, say

_FREEDOMS = (
    "The scale cannot be observed: g(0) = 0, g(255) = 1, V = 1 at the centre; "
    "the shape is compared over grey levels 5…250 after the best scale."
)


@declared("compare")
def command(
    *,
    a: str = argument(),
    b: str = argument(),
    gamma: bool = option("Also print the figures after the best common exponent γ: g^γ and V^γ."),
    plot: Path | None = PLOT,
    as_json: bool = AS_JSON,
) -> None:
    """Compare calibration A with calibration B, which is treated as the truth.

    Each is a calibration.json, a pcalib.txt, a vignette.png, a pair 'pcalib.txt,vignette.png', a folder with them, or
    a file of hugin (.pto), Adobe (.lcp), lensfun (.xml) or OpenCV (.yml). If one file does not state the image size,
    the size of the other is used.
    """
    from rich.table import Table

    from ospc.cli.calibration_result import error_rows, errors_as_dict
    from ospc.evaluation.comparison import aligning_exponent, compare
    from ospc.formats.opening import open_both

    first, second = open_both(a, b)
    results = {"unaligned": compare(first, second)}
    if gamma:
        results["gamma_aligned"] = compare(first, second, aligning_exponent(first, second))
    if plot is not None:
        from ospc.report.pictures import plot_photometries

        plot_photometries([first, second], plot)
    if as_json:
        figures: dict[str, Any] = {
            name: {"exponent": result.exponent} | errors_as_dict(result) for name, result in results.items()
        }
        print_json({"a": a, "b": b, "freedoms": _FREEDOMS} | figures)
        return
    table = Table("", title=None)
    columns = []
    for result, heading in zip(results.values(), ("unaligned", "after γ = {:.4f}"), strict=False):
        table.add_column(heading.format(result.exponent), justify="right")
        columns.append(error_rows(result))
    for label in columns[0]:
        table.add_row(label, *(column.get(label, "") for column in columns))
    say(f"{a}  against  {b}")
    console(soft_wrap=True).print(table)
    say(_FREEDOMS)
    if first.size and second.size and first.size != second.size:
        sizes = " and ".join(f"{width}x{height}" for width, height in (first.size, second.size))
        say(f"The images have {sizes} pixels, so vignettes are compared along the half diagonals only.")
    if gamma:
        say("The second column raises response and vignette of the first to one common exponent.")
    if plot is not None:
        say(f"plot: {plot}")
