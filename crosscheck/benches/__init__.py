"""One sweep per file: `NAME_.py` with a `SWEEP` says what `crosscheck bench` does with the engine NAME."""
