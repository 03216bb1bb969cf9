"""`python -m trunk_ocp` is `trunk-ocp`."""

from .cli.entry import trunk_ocp

if __name__ == "__main__":
    trunk_ocp()
