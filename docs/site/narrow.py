"""Pages on a phone and on paper: small letters of pictures grow, numbers and options stay whole."""

import posixpath
import re
from collections.abc import Mapping
from functools import cache
from math import ceil
from pathlib import Path

_IMAGE = re.compile(r'<img [^>]*src="([^"]+\.svg)"[^>]*>')
_WIDTH = re.compile(r'<svg [^>]*viewBox="\S+ \S+ ([\d.]+)')
_LETTERS = re.compile(r"font-size: ([\d.]+)px")
_SMALL = 1 / 64
"""Share of a picture's width below which its letters cannot be read on a phone."""
_READABLE_PX = 6.5
"""Size of the smallest letters of a picture that scrolls."""


def with_scrolling_pictures(page: str, uri: str, pictures: Mapping[str, Path]) -> str:
    """Put every picture with small letters into a box that scrolls sideways on a phone.

    Parameters
    ----------
    page : HTML of the page
    uri : place of the page on the site
    pictures : files of the pictures by their places on the site
    """

    def boxed(image: re.Match[str]) -> str:
        place = posixpath.normpath(posixpath.join(posixpath.dirname(uri), image[1]))
        path = pictures.get(place)
        width_px = _readable_width(path) if path else 0
        if not width_px:
            return image[0]
        return f'<span class="sideways" style="--readable: {width_px}px">{image[0]}</span>'

    return _IMAGE.sub(boxed, page)


@cache
def _readable_width(path: Path) -> int:
    """Return the width in pixels at which a picture's smallest letters are read; 0 if any will do."""
    text = path.read_text(encoding="utf-8")
    width = _WIDTH.search(text)
    sizes = [float(size) for size in _LETTERS.findall(text)]
    if not width or not sizes:
        return 0
    share = min(sizes) / float(width[1])
    if share >= _SMALL:
        return 0
    return ceil(_READABLE_PX / share)


_TABLE = re.compile(r"<table>.*?</table>", re.S)
_HYPHENED_NUMBER = re.compile(r"(?<=[>\s(])[-+]?[\d.]+e-\d+(?=[<\s;,)])")


def with_whole_numbers(page: str) -> str:
    """Keep the numbers of tables, which a browser breaks after the hyphen of an exponent, on a line."""

    def kept_whole(table: re.Match[str]) -> str:
        return _HYPHENED_NUMBER.sub(r'<span class="whole">\g<0></span>', table[0])

    return _TABLE.sub(kept_whole, page)


_CODE = re.compile(r"(?<=<code>).*?(?=</code>)", re.S)
_OPTION = re.compile(r"(?<![\w-])--?[a-z][\w-]*(?![^<]*>)")


def with_whole_options(page: str) -> str:
    """Keep options such as ``--no-times``, which a browser breaks after a hyphen, on a line."""

    def kept_whole(code: re.Match[str]) -> str:
        return _OPTION.sub(r'<span class="whole">\g<0></span>', code[0])

    return _CODE.sub(kept_whole, page)
