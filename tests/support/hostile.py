"""Names that try to break out of the text they are written into."""

CODE = 'raise SystemExit("broke out")'
ORDINARY = "Asian elephant, young female (µ=0.3)"

HOSTILE = {
    "python": f'"""\n{CODE}\n"""',
    "python's other quotes": f"'''\n{CODE}\n'''",
    "unlucky quotes": 'a"""b',
    "a string's end": f'" + {CODE} + "',
    "an escape": "\\",
    "escaped quotes": '\\"\\"\\"',
    "c": '*/\n#error "broke out"\n/*',
    "a comment in a comment": "x /* y",
    "an escaped newline": "x *??/\n/ \\",
    "trigraphs": "??/\" ??' ??=error",
    "matlab": "\n%}\nerror('broke out')\n%{",
    "latex": "\\input{/etc/passwd} $x^ %\n\\end{document} {{ #~&_",
    "html": '</script><script>alert(1)</script><!-- "',
    "formula": "$\\frac{1}{$",
    "template": "<about> <<muscle>> @HEADER@ /* @sizes@ */ {{data}} @NAME@",
    "bidi": "abc\u202eedoc\u2066",
    "line ends": "a\x0b\x0c\x1c\x85\u2028\u2029\r\nraise SystemExit",
    "terminal": "\x1b]0;owned\x07\x00\x7f",
    "scripts": "象の鼻 слон חוטם Rüssel ß 😀",
    "half a character": "\ud83d",
    "long": "x " * 5000,
    "long word": "W" * 10_000,
    "ordinary": ORDINARY,
}
