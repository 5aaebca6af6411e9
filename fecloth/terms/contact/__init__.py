"""Contact of the cloth with rigid obstacles."""

from fecloth.terms.contact import shapes

__all__ = ["shapes"]
