"""Entry point of ``python -m beltid`` and of the command ``beltid``."""

from beltid.cli import main

__all__ = ["main"]

if __name__ == "__main__":
    main()
