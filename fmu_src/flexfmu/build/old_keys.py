"""Keys of files from before methods had names, and the method that stands in their place."""

from collections.abc import Mapping

from ..model.methods import Division, Kinematics, LoadPlacement, Method, Recipe, Stiffness, recipe_of

OLD_KEYS = ("kinematics", "loads", "stiffness", "division", "evaluation")
"""Keys that `[formulation]` had."""
_USUAL = {
    "kinematics": "corotated",
    "loads": "deformed",
    "stiffness": "constant",
    "division": "tree",
    "evaluation": "implicit",
}


def replaced(old: Mapping[str, object]) -> str:
    """What to write instead of a combination of old keys.

    Parameters
    ----------
    old : mapping of str to object
        Keys of `OLD_KEYS`, as a file has them; what is not there was the usual one.

    Returns
    -------
    str
        A sentence that names the method.
    """
    words = {key: str(old.get(key, usual)) for key, usual in _USUAL.items()}
    given = ", ".join(f"{key} = {str(old[key])!r}" for key in _USUAL if key in old).replace("'", '"')
    try:
        recipe = _known_name(
            Recipe(
                Kinematics(words["kinematics"]),
                LoadPlacement(words["loads"]),
                Stiffness(words["stiffness"]),
                Division(words["division"]),
            )
        )
    except ValueError:
        names = ", ".join(method.value for method in Method)
        return f"{given} is answered by method now, one of {names}"
    same = next((method for method in Method if recipe_of(method) == recipe), None)
    if words["evaluation"] == "explicit":
        return (
            f'{given}: explicit evaluation is gone. Write method = "{(same or _nearest(recipe)).value}"; for the '
            'moment u × F of the last step, take method = "linear" and let the master send that moment'
        )
    if same is not None:
        return f'write method = "{same.value}" instead of {given}'
    return f'{given} is gone; method = "{_nearest(recipe).value}" comes nearest'


def _known_name(recipe: Recipe) -> Recipe:
    """The recipe, under the one name of those that are the same."""
    if recipe.kinematics is Kinematics.LINEAR:
        # Linear kinematics know no frames, and their constant derivative leaves loads where they are.
        loads = LoadPlacement.REFERENCE if recipe.loads is LoadPlacement.DEFORMED else recipe.loads
        return Recipe(recipe.kinematics, loads, recipe.stiffness)
    return recipe


def _nearest(recipe: Recipe) -> Method:
    """The method that comes nearest to a combination that has gone."""
    match recipe.kinematics:
        case Kinematics.LINEAR:
            # The moment (3) on a body without frames is a part of what the load does to the stiffness.
            by_mode = recipe.stiffness is Stiffness.BY_MODE
            return Method.STIFFNESS_BY_MODE if by_mode else Method.STIFFNESS_BY_LOAD
        case Kinematics.LITERAL:
            return Method.MODAL_ROTATION
        case Kinematics.SECANT:
            return Method.HALF_ROTATION
        case Kinematics.SECOND_ORDER:
            return Method.SECOND_ORDER
        case Kinematics.COROTATED:
            if recipe.stiffness is not Stiffness.CONSTANT:
                return Method.FRAMES_STIFFNESS
            return Method.FLOATING_FRAME if recipe.division is Division.ONE else Method.FRAMES
