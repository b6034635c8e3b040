"""What is stored and what is made of it: runs, identifications, banks, reports, upkeep. Knows no HTTP."""
