"""Values that are made many times a frame: frozen for readers and for mypy, and not checked while a run goes on.

A frozen dataclass sets every field through ``object.__setattr__``, which makes it three times as slow to construct as
one that is not. What a plugin gets hold of (poses, estimates, beliefs, frames) is frozen indeed; the states between,
which nobody outside of an estimator sees, are declared so and checked by mypy alone::

    @quick_dataclass(frozen=True, slots=True, eq=False)
    class OdomState:
        stamp_s: float
"""

from __future__ import annotations

from typing import TYPE_CHECKING

__all__ = ["new_tuple", "quick_dataclass"]

#: ``new_tuple(Named, values)`` is a named tuple of all of its values, in half the time of ``Named(*values)``.
new_tuple = tuple.__new__

if TYPE_CHECKING:
    from dataclasses import dataclass as quick_dataclass
else:
    from dataclasses import dataclass

    def quick_dataclass(*, frozen, slots, eq=True):
        """Return a decorator like `dataclasses.dataclass`; values of equal fields are equal and hash alike."""
        assert frozen
        return dataclass(slots=slots, eq=eq, unsafe_hash=eq)
