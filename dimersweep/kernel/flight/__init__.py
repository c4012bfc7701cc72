"""Free motion in closed form, and the next landing."""
