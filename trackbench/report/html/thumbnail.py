"""A figure as a small picture: its shapes without letters and ticks, in few points."""

import re
from collections.abc import Iterator
from xml.etree import ElementTree as ET

from trackbench.report.html.svg import cleaned, outline

_SVG = "{http://www.w3.org/2000/svg}"
_APART = 2.0
"""Points of a line that are nearer to each other than this, in the SVG's, are one."""
_MOST = 60_000
"""Bytes of a raster image beyond which it is left out."""
_STYLE = re.compile(r"(fill|stroke|opacity|fill-opacity|stroke-dasharray)\s*:\s*([^;]+)")


def thumbnail(content: bytes) -> str:
    """Return the SVG as an element of some kilobytes, without ids, so that many may stand on a page."""
    root = cleaned(content, "a figure")
    small = ET.Element(f"{_SVG}svg", {"viewBox": root.get("viewBox", "0 0 504 252")})
    for element in _drawn(root):
        name = element.tag.removeprefix(_SVG)
        if name == "image":
            kept = {k: v for k, v in element.attrib.items() if k.rpartition("}")[2] in _OF_IMAGE}
            ET.SubElement(small, element.tag, kept)
            continue
        d = _coarse(element.get("d", ""))
        look = dict(_STYLE.findall(element.get("style", "")))
        if d and look.get("stroke", look.get("fill", "none")) != "none":
            wide = {"stroke-width": "2.5"} if "stroke" in look else {}
            look.pop("stroke-dasharray", None)
            ET.SubElement(small, element.tag, {"d": d, "fill": "black"} | look | wide)
    return ET.tostring(small, encoding="unicode")


_OF_IMAGE = ("href", "transform", "width", "height", "x", "y", "preserveAspectRatio")


def _drawn(root: ET.Element) -> Iterator[ET.Element]:
    """Yield paths and images in the data area of axes, without grid lines."""
    for element in root:
        if re.search(r"[xy]tick_\d+$", element.get("id", "")) or element.tag == f"{_SVG}defs":
            continue
        name = element.tag.removeprefix(_SVG)
        shape = name == "path" and "clip-path" in element.attrib
        if shape or (name == "image" and len("".join(element.attrib.values())) < _MOST):
            yield element
        else:
            yield from _drawn(element)


def _coarse(d: str) -> str:
    """Return a path of straight lines in whole points, without those that are hardly apart."""
    parts = []
    for points, closed in outline(d):
        kept = [points[0]]
        for point in points[1:]:
            if max(abs(point[0] - kept[-1][0]), abs(point[1] - kept[-1][1])) >= _APART:
                kept.append(point)
        if len(kept) > 1:
            text = " ".join(f"{x:.0f},{y:.0f}" for x, y in kept)
            parts.append(f"M{text}{'z' if closed else ''}")
    return "".join(parts)
