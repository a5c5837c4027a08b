"""SVG of a figure for a page: clean it, and make its ids unique."""

import re
from functools import cache
from xml.etree import ElementTree as ET

from trackbench.errors import UserError

_SVG = "http://www.w3.org/2000/svg"
_XLINK = "http://www.w3.org/1999/xlink"
_DRAWING = (
    "svg title defs g a path use rect image text tspan clipPath pattern linearGradient stop filter"
    " feColorMatrix feComposite"
)
_ELEMENTS = {f"{{{_SVG}}}{name}" for name in _DRAWING.split()}
"""Elements that matplotlib draws with; any other element is dropped with all that is in it."""
_LOOKS = re.compile(
    "fill|fill-(opacity|rule)|stroke|stroke-[a-z]+|opacity|font|font-[a-z]+|text-anchor|clip-path"
    "|clip-rule|shape-rendering|image-rendering|stop-color|stop-opacity|filter"
)
"""Properties of a style, and attributes of the same names."""
_PLACES = re.compile(
    "[xy][12]?|d[xy]|width|height|viewBox|version|transform|offset|preserveAspectRatio|patternUnits"
    "|gradient(Units|Transform)|in2?|operator|result|type|values|k[1-4]|color-interpolation"
)
_ANY_CONTENT = {"d", "id", "data-live", "data-axes", "data-of", "data-key"}
"""Attributes that may have any content: browser, script and style sheet neither run nor follow it."""
_REFERENCE = re.compile(r"url\(#([^()]+)\)")
"""Reference to an id. A bracket ends the search, so that the time grows with the length of a text."""
_HARMLESS = re.compile(r"(?!.*url\()[-\w\s#.,;%'\"()+]*", re.IGNORECASE | re.DOTALL)
"""A value that refers to nothing outside its file, once `_REFERENCE` is cut out of it."""
_MOST_NESTED = 100
"""Groups within groups. matplotlib draws with some ten."""


def clean_svg(content: bytes, name: str) -> ET.Element:
    """Return the root of an SVG file, with only the elements and attributes that draw.

    A results folder may be from anybody, and a script in its figures must not run. ``name`` is that of
    the figure, for messages. Raises UserError if the content is no SVG.
    """
    ET.register_namespace("", _SVG)
    ET.register_namespace("xlink", _XLINK)
    try:
        root = ET.fromstring(content)
    except ET.ParseError as error:
        raise UserError(f"figures/{name}.svg: is not an SVG file: {error}") from None
    if root.tag != f"{{{_SVG}}}svg":
        raise UserError(f"figures/{name}.svg: is not an SVG file: it begins with {root.tag}")
    _check_depth(root, name)
    _clean_element(root)
    return root


def _check_depth(root: ET.Element, name: str) -> None:
    """Raise UserError if groups are nested so deep that recursive functions would fail."""
    level = [root]
    depth = 0
    while level:
        children: list[ET.Element] = []
        for element in level:
            children += element
        level = children
        depth += 1
        if depth > _MOST_NESTED:
            message = f"has groups within groups, more than {_MOST_NESTED} deep, as no figure has"
            raise UserError(
                f"figures/{name}.svg: {message}; draw it again: trackbench plot RESULTS"
            )


def inline(content: bytes, name: str, title: str) -> str:
    """Return an SVG file as the text of an element that a page may contain.

    The ids in it start with ``name``, so that they differ from those of other figures. ``title`` is what
    a screen reader reads.
    """
    root = clean_svg(content, name)
    for element in root.iter():
        for key, value in element.attrib.items():
            element.set(key, _renamed(key, value, name))
    width = root.attrib.pop("width", "")
    root.attrib.pop("height", None)
    # matplotlib writes these properties into a style sheet, which would apply to the whole page.
    # `clean_svg` has dropped the sheet; the figure's own element gets the properties.
    look = "stroke-linejoin: round; stroke-linecap: butt"
    # The page's style sheet gives the figure its natural width, so that letters are of one size in
    # narrow figures and in wide ones. A figure as wide as a page, 504 pt, has 65 rem.
    points = re.fullmatch(r"([0-9.]+)pt", width)
    if points:
        look += f"; --natural: {float(points.group(1)) / 7.75:.1f}rem"
    root.set("style", look)
    root.set("role", "img")
    root.set("aria-labelledby", f"{name}-title")
    label = ET.Element(f"{{{_SVG}}}title", {"id": f"{name}-title"})
    label.text = title
    root.insert(0, label)
    return ET.tostring(root, encoding="unicode")


def _clean_element(element: ET.Element) -> None:
    """Remove all children and attributes but those that are known to draw, at all depths.

    A script, an event handler or a link in a file from elsewhere must not reach the page. A property of
    a style that is no look, or that refers to another file, is cut out of the attribute.
    """
    for key, value in list(element.attrib.items()):
        if key == "style":
            element.set(key, _style(value))
        elif not _may_stay(element.tag, key, value):
            del element.attrib[key]
    for child in list(element):
        if child.tag in _ELEMENTS:
            _clean_element(child)
        else:
            element.remove(child)


def _may_stay(tag: str, key: str, value: str) -> bool:
    """Test whether an attribute, ``key`` with ``value``, of an element ``tag`` is kept.

    It is kept if it has a part in drawing and refers to nothing outside the file.
    """
    if key in ("href", f"{{{_XLINK}}}href"):
        is_picture = tag == f"{{{_SVG}}}image" and value.startswith("data:image/png;base64,")
        return is_picture or value.startswith("#")
    if key in _ANY_CONTENT:
        return True
    draws = _PLACES.fullmatch(key) or _LOOKS.fullmatch(key)
    return draws is not None and _is_harmless(value)


def _is_harmless(value: str) -> bool:
    """Test whether a value refers to nothing but ids of its own file."""
    return _HARMLESS.fullmatch(_REFERENCE.sub("", value)) is not None


@cache
def _style(text: str) -> str:
    """Return the value of an attribute ``style`` without properties that have no part in drawing."""
    properties = [part.partition(":") for part in text.split(";") if part.strip()]
    allowed = []
    for name, colon, value in properties:
        if _LOOKS.fullmatch(name.strip()) and _is_harmless(value):
            allowed.append((name, colon, value))
    if allowed == properties:
        return text
    return ";".join(map("".join, allowed))


def _renamed(key: str, value: str, name: str) -> str:
    """Rename the ids in an attribute's value: they start with ``name``."""
    if key == "id":
        return f"{name}-{value}"
    # A reference is ``url(#ID)``, or ``#ID`` in an attribute href, which may have a namespace.
    if key.rpartition("}")[2] != "href":
        return _REFERENCE.sub(rf"url(#{name}-\1)", value)
    if value.startswith("#"):
        return f"#{name}-{value[1:]}"
    return value
