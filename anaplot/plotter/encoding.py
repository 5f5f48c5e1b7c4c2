"""Values of an axis as the device writes them: the counterpart of the decoder."""

from __future__ import annotations

from anaplot.plotter.schema import AxisFormat
from anaplot.plotter.template import Value

__all__ = ["encode_value"]


def encode_value(axis: AxisFormat, value: float) -> Value:
    """Prepare a value for a record's template.

    Parameters
    ----------
    axis
        How the device writes it.
    value
        In the device's units.

    Returns
    -------
    float, int or bytes
        A number for the template to format, or the bytes of a binary encoding: as many as the
        axis' range needs.
    """
    if axis.encoding == "decimal":
        return value
    whole = round(value)
    if axis.encoding == "integer":
        return whole
    if axis.encoding == "hex":
        return max(0, whole)
    largest = max(abs(axis.low), abs(axis.high)) / axis.scale
    if axis.encoding in ("bits6", "bits7"):
        bits = 6 if axis.encoding == "bits6" else 7
        count = max(1, -(-int(largest).bit_length() // bits))
        whole = max(0, whole)
        return bytes((whole >> (bits * at)) & ((1 << bits) - 1) for at in range(count))
    count = int(largest).bit_length() // 8 + 1
    order = "little" if axis.encoding == "int-le" else "big"
    return whole.to_bytes(count, order, signed=True)  # type: ignore[arg-type]
