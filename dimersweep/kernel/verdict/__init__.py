"""The verdict on a run: the motion that it has settled to."""
