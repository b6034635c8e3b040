"""The tick, compiled: what is measured is looked at, a motion decides, a row says what happened."""
