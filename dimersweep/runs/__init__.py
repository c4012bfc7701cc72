"""One run: its outcome, its record, its errors, its stability."""
