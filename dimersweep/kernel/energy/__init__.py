"""The works of the forces of a recorded run: in contact phases, and in impacts, whose law is integrated anew."""
