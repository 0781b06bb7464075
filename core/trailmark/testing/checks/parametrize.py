"""Checks as parameters of one test, each of which may be expected to fail, with a reason."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NoReturn

from trailmark.plugins.hints import nearest_or_all

if TYPE_CHECKING:
    import pytest

__all__ = ["Check", "parametrize", "skip"]

#: A check: raises `AssertionError` with what was expected and what came instead.
Check = Callable[[], None]


def parametrize(
    checks: Mapping[str, Check], expected_failures: Mapping[str, str] | None = None
) -> pytest.MarkDecorator:
    """Return ``pytest.mark.parametrize("check", ...)`` with a parameter for each check.

    Parameters
    ----------
    checks : mapping of str to callable
        By name, which becomes the test's id.
    expected_failures : mapping of str to str
        Checks that the part is known not to pass, and why. One that passes all the same fails the test, so that
        the list does not outlive its reasons.

    Raises
    ------
    ValueError
        If a name of `expected_failures` is no check, or a reason is empty.
    """
    import pytest

    expected = dict(expected_failures or {})
    for name, reason in expected.items():
        if name not in checks:
            raise ValueError(f"expected_failures: no check is called {name!r}{nearest_or_all(name, checks, 'checks')}")
        if not reason.strip():
            raise ValueError(f"expected_failures: say why {name!r} is expected to fail")
    parameters = [
        pytest.param(check, id=name, marks=[pytest.mark.xfail(strict=True, reason=expected[name])])
        if name in expected
        else pytest.param(check, id=name)
        for name, check in checks.items()
    ]
    return pytest.mark.parametrize("check", parameters)


def skip(reason: str) -> NoReturn:
    """Skip the running test: the check does not apply."""
    import pytest

    pytest.skip(reason)
