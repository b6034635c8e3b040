"""``python -m backend`` is ``sinew``."""

from backend.cli import main

if __name__ == "__main__":
    main()
