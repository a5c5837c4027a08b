"""A figure's SVG made fit to stand inside a page: no scripts, no clashing ids, a name for readers."""

import re
from collections.abc import Iterator
from xml.etree import ElementTree as ET

from trackbench.experiment.problems import UserError

_SVG = "http://www.w3.org/2000/svg"
_XLINK = "http://www.w3.org/1999/xlink"
_DROPPED = {"script", "metadata", "foreignObject", "style", "animate", "set", "iframe"}
_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_PATH = re.compile(r' d="([MLZz0-9eE.\s+-]+)"')
_NUMBER = re.compile(r"-?(?:\d+\.?\d*|\.\d+)(?:e-?\d+)?")
_POINT = re.compile(r"([MLZz])([^MLZz]*)")


def compact(content: str) -> str:
    """The same drawing in half the bytes: straight lines in hundredths of a point, from the last one."""
    return _PATH.sub(lambda path: f' d="{_relative(path.group(1))}"', content)


def _relative(path: str) -> str:
    out, at, start = [], (0, 0), (0, 0)
    for command, numbers in _POINT.findall(path):
        if command in "Zz":
            out.append("z")
            at = start
            continue
        x, y = (round(100.0 * float(number)) for number in numbers.split())
        if command == "M":
            start = (x, y)
            out.append(f"M{_hundredths(x)} {_hundredths(y)}")
        else:
            out.append(f"l{_hundredths(x - at[0])} {_hundredths(y - at[1])}")
        at = (x, y)
    return "".join(out).replace(" -", "-")


def _hundredths(number: int) -> str:
    text = f"{number / 100:.2f}".rstrip("0").rstrip(".")
    return text.replace("0.", ".", 1) if abs(number) < 100 and number else text


def outline(d: str) -> Iterator[tuple[list[tuple[float, float]], bool]]:
    """The points of each stroke of a `compact` path, and whether it is closed; none of curves."""
    if not re.fullmatch(r"[MlLz0-9e.\s+-]*", d):
        return
    x = y = 0.0
    for stroke in filter(None, d.split("M")):
        points = []
        for letter, numbers in re.findall(r"([lL]?)([^lLz]+)", stroke):
            a, b = map(float, _NUMBER.findall(numbers)[:2])
            x, y = (x + a, y + b) if letter == "l" else (a, b)
            points.append((x, y))
        yield points, "z" in stroke


def cleaned(content: bytes, name: str) -> ET.Element:
    """The SVG without what could run code or reach outside; raises UserError if it is none."""
    ET.register_namespace("", _SVG)
    ET.register_namespace("xlink", _XLINK)
    try:
        root = ET.fromstring(content)
    except ET.ParseError as error:
        raise UserError(f"figures/{name}.svg: is not an SVG file: {error}") from None
    _clean(root)
    return root


def inline(content: bytes, name: str, title: str) -> str:
    """The SVG as an element; ids start with ``name``, ``title`` is what a screen reader says."""
    root = cleaned(content, name)
    for element in root.iter():
        for key, value in list(element.attrib.items()):
            kept = _attribute(key, value, name)
            if kept is None:
                del element.attrib[key]
            else:
                element.set(key, kept)
    width = root.attrib.pop("width", "")
    root.attrib.pop("height", None)
    # What matplotlib says in a style sheet, which would reach the whole page.
    look = "stroke-linejoin: round; stroke-linecap: butt"
    points = re.fullmatch(r"([0-9.]+)pt", width)
    if points:  # so that letters are of one size in narrow figures and in wide ones
        look += f"; --natural: {float(points.group(1)) / 9.7:.1f}rem"
    root.set("style", look)
    root.set("role", "img")
    root.set("aria-labelledby", f"{name}-title")
    label = ET.Element(f"{{{_SVG}}}title", {"id": f"{name}-title"})
    label.text = title
    root.insert(0, label)
    return ET.tostring(root, encoding="unicode")


def _clean(element: ET.Element) -> None:
    for child in list(element):
        if not isinstance(child.tag, str) or child.tag.rpartition("}")[2] in _DROPPED:
            element.remove(child)
        else:
            _clean(child)


def _attribute(key: str, value: str, name: str) -> str | None:
    """The attribute with its ids renamed; None if it could run code or reach outside."""
    local = key.rpartition("}")[2].lower()
    if local.startswith("on"):
        return None
    if local == "id":
        return f"{name}-{value}"
    if local == "href":
        if value.startswith("#"):
            return f"#{name}-{value[1:]}"
        return value if value.startswith("data:image/png") else None
    return _REFERENCE.sub(rf"url(#{name}-\1)", value)
