/** Texts of the pages before sign-in. */
export const TEXTS = {
  cookiesBlocked: "Cookies are blocked",
  cookiesHint:
    "This browser blocks cookies for {host}, so nobody can sign in and STOP does not work here. Allow cookies for {host} and reload this page. Until then, use the stop at the machine.",
  title: "Sign in to Sinew",
  lead: "Open the sign-in link that the service printed when it started, or paste its token here. The token is also in the data folder.",
  stopHint:
    "STOP works here if this browser has signed in and has not signed out since. If STOP is not confirmed, use the stop at the machine.",
  token: "Token",
  name: "Your name",
  nameHint: "Shown to other users of this machine",
  signIn: "Sign in",
} as const;
