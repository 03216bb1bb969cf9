"""Escaping of text from files, such as an anatomy's name, for generated sources.

Such text is not trusted. It reaches a source only through one of these functions: as a literal of
its language, or as a comment without characters that a compiler or interpreter acts on.
"""

from __future__ import annotations

import unicodedata

MAX_NAME = 200
"""Characters of a name in a comment; an anatomy file allows no more."""
MAX_UNBROKEN = 8
"""Characters of a word on a LaTeX page after which a line may break."""

_HARMLESS = frozenset(" .,:;=+-_()[]'")
_SPECIAL = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
_SPECIAL |= {character: f"\\{character}" for character in "&%$#_{}"}
_SPECIAL |= {"<": r"\textless{}", ">": r"\textgreater{}"}
_SPECIAL |= {"|": r"\textbar{}", '"': "''", "`": r"\textasciigrave{}"}


def in_comment(text: str) -> str:
    """Text for a comment or docstring of any language.

    Letters of all scripts and digits stay; characters that could end a comment become "_".
    """
    return "".join(c if c in _HARMLESS or _is_letter(c) else "_" for c in text[:MAX_NAME])


def python_literal(text: str) -> str:
    """Text as a Python literal; `repr` handles any text."""
    return repr(str(text))


def c_literal(text: str) -> str:
    """Text as a C string in UTF-8, with octal escapes for all but plain characters.

    An octal escape ends after three digits whatever follows, unlike a hexadecimal one. Question
    marks are escaped because of trigraphs, spaces because lines are wrapped at them.
    """
    data = str(text).encode("utf-8", "replace")
    plain = (chr(b) if _is_plain(chr(b)) else f"\\{b:03o}" for b in data)
    return f'"{"".join(plain)}"'


def in_latex(text: str) -> str:
    """Text for a LaTeX page or comment, in ASCII because not every LaTeX supports other letters.

    Accents are dropped; letters of other scripts become their code, such as [4E2D].
    """
    parts: list[str] = []
    unbroken = 0
    for character in unicodedata.normalize("NFKD", text[:MAX_NAME]):
        if unicodedata.combining(character):
            continue
        if not (character.isascii() and character.isprintable()):
            parts.append(f"[{ord(character):04X}]")
        else:
            parts.append(_SPECIAL.get(character, character))
        unbroken = 0 if character in " -" else unbroken + len(parts[-1])
        if unbroken >= MAX_UNBROKEN:
            parts.append(r"\allowbreak{}")
            unbroken = 0
    return "".join(parts)


def _is_letter(character: str) -> bool:
    """Letters, digits and their accents, of any script."""
    return unicodedata.category(character)[0] in "LNM"


def _is_plain(character: str) -> bool:
    return character.isascii() and (character.isalnum() or character in ".,:;=+-_()[]")
