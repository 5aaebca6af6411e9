"""fecloth: a continuum cloth solver on Gmsh meshes with Green-strain membranes.

All quantities are in SI units. Stiffness and stress of a fabric are per width [N/m]. `System`,
`march` and `run` are the places to start. `fecloth info` says where the pages are.

The public names stand in ``__init__.pyi``. Each is imported when it is first used.
"""

import lazy_loader

__version__ = "0.2.0"

OTHER_WORDS = {  # names in other packages, and ours for the same thing
    "simulate": "run",
    "solve": "equilibrium",
    "Mesh": "Cloth",
    "Material": "Fabric",
}

_imported, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """Import a public name when it is first used, and return what it stands for.

    Raises AttributeError for an unknown name; the message suggests the closest one, or our name
    for a word of other packages.
    """
    try:
        return _imported(name)
    except AttributeError:
        if name.startswith("_"):  # inspect and pytest look for such names in every module
            raise
        from fecloth.errors import did_you_mean

        our_word = OTHER_WORDS.get(name)
        if our_word:
            remedy = f"Did you mean {our_word!r}?"
        else:
            remedy = did_you_mean(name, __all__)
        text = f"module 'fecloth' has no attribute {name!r}. {remedy}"
        raise AttributeError(text.strip()) from None
