"""The figures that the documents print, computed; ``make figures`` writes them into the pages."""
