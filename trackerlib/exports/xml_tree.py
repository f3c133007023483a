"""XML elements with their text, written as UTF-8."""

from __future__ import annotations

import re
from xml.etree import ElementTree

# What XML 1.0 cannot hold even when escaped.
_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def child(parent: ElementTree.Element, tag: str, text: str | None = None, **attributes: str):
    """A new element at the end of `parent`, with text and attributes."""
    element = ElementTree.SubElement(parent, tag, attributes)
    if text is not None:
        element.text = _FORBIDDEN.sub("?", text)
    return element


def document_text(root: ElementTree.Element) -> str:
    """The whole XML document, indented, with its declaration."""
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"
