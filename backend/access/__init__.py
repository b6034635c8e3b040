"""Who may do what: sign-in, tokens, sessions, names, and who holds control. Knows no HTTP."""
