import { BASE } from "../../wire/address";
import { readStored, storedNames, storeText } from "../../wire/browserStorage";

/**
 * Stores drafts in the browser: inputs that a person has not yet saved, sent or started. A draft survives a change of the
 * page and a reload. It belongs to one person at one station. If the browser stores nothing, the draft remains in
 * memory: it survives a change of the page, but not a reload.
 */

/** Version of the stored form. A draft of another version is not read. */
const FORMAT = 1;
const PREFIX = "sinew-draft";

interface StoredDraft {
  readonly value: unknown;
  /** Time of the first change, as an ISO 8601 text. */
  readonly since: string;
}

/** Person and form of a draft. Until the person is known, the draft remains in memory. */
export interface DraftKey {
  readonly person: string | undefined;
  readonly form: string;
}

const inMemory = new Map<string, string>();
const listeners = new Set<() => void>();

/** Returns the stored text of a draft; null if there is none. */
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

/** Stores a draft that was typed before the person was known, unless the person has one. */
export function claimDraft(of: DraftKey): void {
  if (of.person === undefined || !inMemory.has(of.form)) return;
  write(of, storedDraft(of));
}

/** Parses a stored draft. Returns null for none, for another version and for other data. */
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

/** Stores a draft; null removes it. The time of its first change does not change. */
export function storeDraft(of: DraftKey, value: unknown): void {
  const since = parseDraft(storedDraft(of))?.since ?? new Date().toISOString();
  write(of, value === null ? null : JSON.stringify({ format: FORMAT, since, value }));
}

/** Calls `listener` when a draft changes, in this page or in another tab; returns a function that stops this. */
export function watchDrafts(listener: () => void): () => void {
  listeners.add(listener);
  globalThis.addEventListener("storage", listener);
  return () => {
    listeners.delete(listener);
    globalThis.removeEventListener("storage", listener);
  };
}

/** Moves the drafts of a person to a new name, except for forms of which the new name has a draft. */
export function renameDrafts(before: string, after: string): void {
  const prefix = keyOf({ person: before, form: "" });
  for (const key of [...storedNames("localStorage"), ...inMemory.keys()]) {
    if (!key.startsWith(prefix)) continue;
    const form = key.slice(prefix.length);
    const to = { person: after, form };
    if (storedDraft(to) === null) write(to, storedDraft({ person: before, form }));
  }
}

function write(of: DraftKey, text: string | null): void {
  const key = keyOf(of);
  inMemory.delete(of.form);
  inMemory.delete(key);
  const isInBrowser = of.person !== undefined && storeText("localStorage", key, text);
  if (!isInBrowser && text !== null) inMemory.set(key, text);
  for (const listener of listeners) listener();
}

/** Returns the storage key, without the number that the service appends to a name in use; it may change. */
function keyOf({ person, form }: DraftKey): string {
  return person === undefined ? form : `${PREFIX} ${BASE} ${person.replace(/ \(\d+\)$/, "")} ${form}`;
}
