"""Names of metrics. A name carries its protocol: ``ate_rmse_m[se2,n=1200]``."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["find_metric", "metric_name", "number_text", "quantity_of"]


def metric_name(quantity: str, *protocol: str) -> str:
    """Return ``quantity[protocol,...]``; the quantity alone without a protocol.

    Parameters
    ----------
    quantity : str
        Name of the quantity with its unit: ``ate_rmse_m``.
    *protocol : str
        How it was measured: ``se2``, ``n=1200``.

    Returns
    -------
    str
        The name under which ``metrics.json`` has it.
    """
    return f"{quantity}[{','.join(protocol)}]" if protocol else quantity


def quantity_of(name: str) -> str:
    """Return the quantity of a metric's name: ``ate_rmse_m`` of ``ate_rmse_m[se2,n=1200]``.

    Parameters
    ----------
    name : str
        As `metric_name` returns it.

    Returns
    -------
    str
        What stands before the bracket.
    """
    return name.partition("[")[0]


def find_metric(metrics: Mapping[str, float | None], quantity: str, *protocol: str) -> float | None:
    """Return the first metric of a quantity whose protocol holds all the given words, or None.

    Parameters
    ----------
    metrics : mapping of str to float or None
        Numbers by full name; None where one is infinite or not known.
    quantity : str
        Name without a protocol.
    *protocol : str
        Words that the protocol must hold.

    Returns
    -------
    float or None
        The number; None where no metric fits, or the one that fits has none.
    """
    for name, value in metrics.items():
        words = name.partition("[")[2].rstrip("]").split(",")
        if quantity_of(name) == quantity and set(protocol) <= set(words):
            return value
    return None


def number_text(value: float) -> str:
    """Return a number for use inside a name: three digits, no trailing zeros, never an exponent."""
    return f"{float(f'{value:.3g}'):.9f}".rstrip("0").rstrip(".")
