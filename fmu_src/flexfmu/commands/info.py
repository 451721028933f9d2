"""`flexfmu info`: what is in an FMU or a modal file."""

from pathlib import Path
from typing import Annotated

import typer

from .common import Json, reporter


def info(
    file: Annotated[Path, typer.Argument(help="FMU or modal file.")],
    cost: Annotated[
        bool, typer.Option("--cost", help="Time a step of every method that the body has data for.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Show what is in an FMU or a modal file: modes, interfaces, tree of frames, origin."""
    from rich.console import Console

    from ..calls.describing import cost_table, data, describe
    from ..files.plain_data import fields_of, json_text
    from ..fmu.reading import read_packaged_body

    body = read_packaged_body(file)
    costs = {}
    if cost:
        from ..study.cost import step_costs

        costs = step_costs(body, reporter())
    if as_json:
        rows = [{"variant": variant, **fields_of(one)} for variant, one in costs.items()]
        typer.echo(json_text({**data(body), **({"cost": rows} if cost else {})}))
        return
    console = Console(highlight=False)
    for part in describe(body):
        console.print(part)
    if cost:
        console.print(cost_table(costs))
