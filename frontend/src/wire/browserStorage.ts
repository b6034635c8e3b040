/** What a browser keeps for a page, which it may refuse to do: then it throws wherever it is touched. */

type Kind = "localStorage" | "sessionStorage";

/** What was kept under a name; null for nothing, and where the browser keeps nothing. */
export function readStored(kind: Kind, name: string): string | null {
  try {
    return globalThis[kind]?.getItem(name) ?? null;
  } catch {
    return null;
  }
}

/** The names under which something is kept. */
export function storedNames(kind: Kind): string[] {
  try {
    return Object.keys(globalThis[kind] ?? {});
  } catch {
    return [];
  }
}

/** Keep a text under a name, null to forget it. Returns whether the browser did: it may refuse, and the page works without. */
export function storeText(kind: Kind, name: string, text: string | null): boolean {
  try {
    if (text === null) globalThis[kind].removeItem(name);
    else globalThis[kind].setItem(name, text);
    return true;
  } catch {
    return false;
  }
}

/**
 * Whether this browser keeps cookies for this page: without one the service does not know who is signed in. It is tried,
 * as `navigator.cookieEnabled` stays true in Chromium for a person who has blocked them.
 */
export function acceptsCookies(): boolean {
  const tried = "sinew-tried=1";
  try {
    // biome-ignore lint/suspicious/noDocumentCookie: whether a cookie is kept is what is asked
    document.cookie = `${tried}; SameSite=Strict`;
    const isKept = document.cookie.split("; ").includes(tried);
    // biome-ignore lint/suspicious/noDocumentCookie: whether a cookie is kept is what is asked
    document.cookie = `${tried}; SameSite=Strict; Max-Age=0`;
    return isKept;
  } catch {
    return false; // a document without an origin of its own
  }
}
