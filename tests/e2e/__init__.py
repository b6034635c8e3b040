"""The page in a real browser. A package, so that browser and service can be those of the whole folder."""
