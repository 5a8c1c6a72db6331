"""XML elements with a text, and numbers as these formats want them."""

from __future__ import annotations

from xml.etree import ElementTree as ET


def add(parent: ET.Element, tag: str, text: str | None = None) -> ET.Element:
    """A new last child of an element."""
    child = ET.SubElement(parent, tag)
    child.text = text
    return child


def number_text(value: float) -> str:
    """A number in digits alone, exact to the nanometre."""
    text = f"{float(value):.9f}".rstrip("0")
    return f"{text}0" if text.endswith(".") else text
