"""Every page in every state in which a person meets it: for the pictures of the documents and for the rules of looks.

`journey` leads one service through the states, from the sign-in to the trip, and shows each page to whoever looks:
`screenshots` takes pictures, `test_looks` asks axe and measures.
"""
