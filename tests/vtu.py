"""Arrays of files for ParaView."""

from __future__ import annotations

import base64
import zlib
from xml.etree.ElementTree import Element

import numpy as np


def values_of(array: Element) -> np.ndarray:
    """Numbers of a DataArray, as text or packed, a row for every tuple."""
    text = array.text or ""
    if array.get("format") == "binary":
        header, packed = base64.b64decode(text[:24]), base64.b64decode(text[24:])
        kind = {"Float64": "<f8", "Int32": "<i4", "UInt8": "u1"}[array.get("type", "")]
        values = np.frombuffer(zlib.decompress(packed), kind)
        sizes = [1, values.nbytes, values.nbytes, len(packed)]
        assert list(np.frombuffer(header, "<u4")) == sizes
    else:
        values = np.array(text.split(), dtype=float)
    width = int(array.get("NumberOfComponents") or 1) or 1
    return values.reshape(-1, width) if width > 1 else values
