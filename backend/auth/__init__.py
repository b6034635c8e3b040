"""Who may do what: sign-in, tokens, sessions, and the control lease. Knows no HTTP."""
