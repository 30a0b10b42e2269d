"""``ospc evaluate``: figures of merit of results that other programs made."""

from __future__ import annotations

from pathlib import Path

import click


@click.group("evaluate")
def command() -> None:
    """Evaluate trajectories against the truth."""


@command.command("ealign")
@click.argument("trajectory", type=click.Path(path_type=Path))
@click.argument("truth", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
def ealign(trajectory: Path, truth: Path, as_json: bool) -> None:
    """Drift of TRAJECTORY from the alignments to the two halves of TRUTH.

    Both hold rows 'stamp tx ty tz qx qy qz qw', as result.txt of DSO and groundtruthSync.txt of the TUM monocular
    data set; rows of NaN in the truth are unknown. Prints e_align (root mean square distance between the trajectory
    aligned to the first half and to the second, in units of the truth), e_s (ratio of the two scales) and e_r (angle
    between the two rotations, in degrees).
    """
    from ospc.evaluation.trajectory import alignment_error, read_trajectory

    error = alignment_error(read_trajectory(trajectory), read_trajectory(truth))
    if as_json:
        import json

        click.echo(json.dumps(vars(error), indent=1))
        return
    click.echo(f"e_align  {error.e_align:.4f}   in units of the truth")
    click.echo(f"e_s      {error.e_s:.4f}   scale by the first half over scale by the second")
    click.echo(f"e_r      {error.e_r_deg:.3f}°   in degrees")
    click.echo(f"rmse     {error.rmse:.4f}   after one alignment to all of the truth, in its units")
    click.echo(f"poses    {error.poses}, {error.first} with truth in its first half and {error.second} in its second")
    if error.unmatched:
        click.echo(f"         {error.unmatched} have no row of the truth within 1 ms")
