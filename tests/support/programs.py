"""Programs that some tests need and a machine may lack."""

import os
import shutil

import pytest

CHROMIUM = os.environ.get("CHROMIUM", "/usr/bin/chromium")
PACKAGES = {
    CHROMIUM: "chromium, or set CHROMIUM",
    "cc": "gcc",
    "gcc": "gcc",
    "g++": "g++",
    "cmake": "cmake",
    "localedef": "libc-bin",
    "mkoctfile": "octave and octave-dev",
    "octave-cli": "octave and octave-dev",
    "pdflatex": "texlive-latex-base",
    "valgrind": "valgrind",
}


def needs(*programs):
    """Skip the test, with a reason that names what to install, where a program is missing."""
    for program in programs:
        if not shutil.which(program):
            pytest.skip(f"needs {program}: install {PACKAGES[program]}")
