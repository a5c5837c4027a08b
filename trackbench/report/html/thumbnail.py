"""Thumbnail of a figure: an SVG of some kilobytes, of which many may stand on a page."""

import re
from collections.abc import Iterator
from xml.etree import ElementTree as ET

from trackbench.report.html.svg import clean_svg
from trackbench.report.plotting.svg_paths import coarse_path

_SVG = "{http://www.w3.org/2000/svg}"
_MOST_IMAGE_BYTES = 60_000
"""Bytes of a raster image beyond which it is left out."""
_STYLE = re.compile(r"(fill|stroke|opacity|fill-opacity|stroke-dasharray)\s*:\s*([^;]+)")
"""A property of a shape's style, and its value."""


def thumbnail(content: bytes) -> str:
    """Return an SVG as an element of some kilobytes, without ids, so that many may stand on a page.

    It has the lines and areas within the axes, with broad strokes and no text.
    """
    root = clean_svg(content, "a figure")
    # Without a box of its own a figure is taken as 7 by 3.5 inches, in points.
    small = ET.Element(f"{_SVG}svg", {"viewBox": root.get("viewBox", "0 0 504 252")})
    for element in _drawn(root):
        if element.tag == f"{_SVG}image":
            attributes = {}
            for key, value in element.attrib.items():
                if key.rpartition("}")[2] in _IMAGE_ATTRIBUTES:
                    attributes[key] = value
            ET.SubElement(small, element.tag, attributes)
            continue
        path = coarse_path(element.get("d", ""))
        # Properties such as fill and stroke, by name.
        look = dict(_STYLE.findall(element.get("style", "")))
        # matplotlib leaves out the stroke of an area without edges, which its fill makes visible.
        is_visible = look.get("stroke", look.get("fill", "none")) != "none"
        if path and is_visible:
            attributes = {"d": path, "fill": "black"} | look
            attributes.pop("stroke-dasharray", None)
            if "stroke" in look:
                attributes["stroke-width"] = "2.5"
            ET.SubElement(small, element.tag, attributes)
    return ET.tostring(small, encoding="unicode")


_IMAGE_ATTRIBUTES = ("href", "transform", "width", "height", "x", "y", "preserveAspectRatio")


def _drawn(root: ET.Element) -> Iterator[ET.Element]:
    """Yield the paths and small images that are drawn within axes; ticks and grid lines are left out."""
    for element in root:
        # matplotlib's groups of a tick with its grid line: xtick_3.
        is_tick = re.search(r"[xy]tick_\d+$", element.get("id", ""))
        if is_tick or element.tag == f"{_SVG}defs":
            continue
        # matplotlib clips what is drawn within axes, and nothing else.
        is_shape = element.tag == f"{_SVG}path" and "clip-path" in element.attrib
        is_image = element.tag == f"{_SVG}image"
        if is_shape or (is_image and len("".join(element.attrib.values())) < _MOST_IMAGE_BYTES):
            yield element
        else:
            yield from _drawn(element)
