"""Files of borders: what they declare, and how their tables are made part by part."""
