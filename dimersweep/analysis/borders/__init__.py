"""Files of borders: their declarations, and how their tables are made part by part."""
