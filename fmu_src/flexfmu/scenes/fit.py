"""The smallest, fastest model of a body that a scene's tolerance allows, with the reason of each choice."""

import time
from itertools import product
from pathlib import Path

from ..progress import Reporter
from ..store import Store
from ..targets import check_target
from .config import BasisChoice
from .fitting.delivery import Fit, deliver
from .fitting.frames import frames_needed
from .fitting.modes import bases_to_try, cheapest, modes_needed
from .fitting.reasons import limit, reasons
from .fitting.trial import Choice, Plan, Search
from .scene import Scene

# Share of an error that may be added to it where the tolerance is out of reach anyway, for the sake of fewer modes.
_SPARE = 0.05


def fit(scene: Scene, target: Path, report: Reporter, store: Store | None = None, fmu: Path | None = None) -> Fit:
    """Find the smallest, fastest model within the scene's tolerance and write it as a body file, and an FMU.

    Parameters
    ----------
    scene : Scene
    target : Path
        Body file to write; ends in .toml.
    report : Reporter
    store : Store, optional
    fmu : Path, optional
        FMU to write; ends in .fmu. Default: none.

    Returns
    -------
    Fit

    Raises
    ------
    FlexfmuError
        A file cannot be written, or a scene without a reference.
    """
    begun = time.perf_counter()
    check_target(target, (".toml",), inputs=(scene.body,))
    if fmu is not None:
        check_target(fmu, (".fmu",))
    search = Search(scene, report, store)
    _ = search.known
    plenty = max(scene.file.sweep.modes)
    tried = frames_needed(search, plenty)
    chosen = [(one, one.enough) for one in tried if one.enough is not None]
    why, allowed = "", 1.0
    if not chosen:
        one, frames = min(((t, d) for t in tried for d in t.shares), key=lambda pair: pair[0].shares[pair[1]].share)
        why = limit(search, one, frames, plenty)
        allowed = (1.0 + _SPARE) * one.shares[frames].share
        chosen = [(one, frames)]
    found: list[Choice] = []
    searches = list(product(chosen, bases_to_try(scene)))
    title = f"2 of 3: leave out modes under {len(chosen)} methods"
    with report.counted(title, len(searches), "bases") as tell:
        for done, ((one, frames), basis) in enumerate(searches, start=1):
            choice = modes_needed(search, basis, one.variant, frames, plenty, allowed)
            if choice is not None:
                found.append(choice)
            tell(done)
    if not found:
        # Only so many modes with everything: as the frames were found.
        one, frames = chosen[0]
        plan = Plan(BasisChoice.RESIDUAL, plenty, frames)
        found = [Choice(plan, one.variant, search.body(plan, [one.variant]), one.shares[frames])]
    with report.stage(f"3 of 3: time {len(found)} models, and write the best"):
        best = cheapest(search, found)
        return deliver(search, best, reasons(search, tried, found, best, plenty), why, target, fmu, begun)
