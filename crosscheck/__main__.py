"""Entry point of the command: even a broken installation ends in a message and status 4."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line."""
    try:
        from . import cli
    except KeyboardInterrupt:
        sys.exit(130)
    except Exception as e:
        print(f"crosscheck: internal error, broken installation: {type(e).__name__}: {e}", file=sys.stderr)
        sys.exit(4)
    cli.main()


if __name__ == "__main__":
    main()
