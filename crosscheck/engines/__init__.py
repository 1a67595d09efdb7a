"""One adapter per file: `NAME_.py` with a class `ENGINE` is the engine NAME."""
