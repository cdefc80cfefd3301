"""Code in the guides: in blocks, to be typed as it is, and within the text."""

from __future__ import annotations

import re
from collections.abc import Iterator

PREFIX = re.compile(r"^(?:\$ )?(?:sudo(?: -u davpc)? )?(?:\.venv/bin/)?")
_CODE_LINE = re.compile(r"^(?: {4}|\t)(?!\s)(.+)$|^ {7}(\S.+)$", re.MULTILINE)
_INLINE = re.compile(r"`([^`\n]+(?:\n[^`\n]+)?)`")


def snippets(text: str) -> Iterator[tuple[str, bool]]:
    """Code of a guide without its comments; whether it stands in a block, to be typed as it is."""
    for match in _CODE_LINE.finditer(text):
        yield (match[1] or match[2]).split(" #")[0].strip(), True
    prose = _CODE_LINE.sub("", text)
    for match in _INLINE.finditer(prose):
        yield " ".join(match[1].split()), False
