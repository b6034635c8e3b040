import { BASE } from "../../wire/address";
import { readStored, storedNames, storeText } from "../../wire/browserStorage";

/**
 * Stores drafts in the browser: what a person has typed and not yet saved, sent or started. A draft survives leaving the
 * page and a reload. It belongs to one person at one station. Where the browser stores nothing, the draft is held in
 * memory: it survives leaving the page, not a reload.
 */

/** Version of the stored form. A draft of another version is not read. */
const FORMAT = 1;
const PREFIX = "sinew-draft";

interface StoredDraft {
  readonly value: unknown;
  /** When the first change was made, as an ISO 8601 text. */
  readonly since: string;
}

/** Whose draft it is, and of which form. Until the person is known, a draft is held in memory. */
export interface DraftKey {
  readonly person: string | undefined;
  readonly form: string;
}

const inMemory = new Map<string, string>();
const listeners = new Set<() => void>();

/** The stored text of a draft, null where there is none. */
export function storedDraft(of: DraftKey): string | null {
  const unclaimed = inMemory.get(of.form) ?? null;
  if (of.person === undefined) return unclaimed;
  const key = keyOf(of);
  return inMemory.get(key) ?? readStored("localStorage", key) ?? unclaimed;
}

/** Whether a draft survives a reload. */
export function isStored(of: DraftKey): boolean {
  return !inMemory.has(keyOf(of));
}

/** Store the draft that was typed before the person was known, unless the person has one. */
export function claimDraft(of: DraftKey): void {
  if (of.person === undefined || !inMemory.has(of.form)) return;
  put(of, storedDraft(of));
}

/** Parse a stored draft. Returns null for none, for one of another version and for what is no draft. */
export function parseDraft(text: string | null): StoredDraft | null {
  if (text === null) return null;
  try {
    const { format, since, value } = JSON.parse(text) as Record<string, unknown>;
    const isRead = format === FORMAT && typeof since === "string" && !Number.isNaN(Date.parse(since));
    return isRead ? { value, since } : null;
  } catch {
    return null;
  }
}

/** Store a draft; null removes it. A draft keeps the time of its first change. */
export function storeDraft(of: DraftKey, value: unknown): void {
  const since = parseDraft(storedDraft(of))?.since ?? new Date().toISOString();
  put(of, value === null ? null : JSON.stringify({ format: FORMAT, since, value }));
}

/** Call `listener` when a draft changes, in this page or in another tab; returns how to stop that. */
export function watchDrafts(listener: () => void): () => void {
  listeners.add(listener);
  globalThis.addEventListener("storage", listener);
  return () => {
    listeners.delete(listener);
    globalThis.removeEventListener("storage", listener);
  };
}

/** Give the drafts of a person to the name that the person has taken, but for forms of which that name has one. */
export function renameDrafts(before: string, after: string): void {
  const beginning = keyOf({ person: before, form: "" });
  for (const key of [...storedNames("localStorage"), ...inMemory.keys()]) {
    if (!key.startsWith(beginning)) continue;
    const form = key.slice(beginning.length);
    const to = { person: after, form };
    if (storedDraft(to) === null) put(to, storedDraft({ person: before, form }));
  }
}

function put(of: DraftKey, text: string | null): void {
  const key = keyOf(of);
  inMemory.delete(of.form);
  inMemory.delete(key);
  const isKept = of.person !== undefined && storeText("localStorage", key, text);
  if (!isKept && text !== null) inMemory.set(key, text);
  for (const listener of listeners) listener();
}

/** Who is there twice has a number behind the name, which is another one the next time. */
function keyOf({ person, form }: DraftKey): string {
  return person === undefined ? form : `${PREFIX} ${BASE} ${person.replace(/ \(\d+\)$/, "")} ${form}`;
}
