"""Every page in every state of the service, for the screenshots and for the accessibility and layout checks.

`journey` brings one service through the states, from the sign-in to the trip, and passes each page to a callback:
`screenshots` takes pictures, `test_looks` runs axe and measures.
"""
