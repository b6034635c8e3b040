import { useQuery } from "@tanstack/react-query";
import { useEffect, useMemo, useReducer, useRef, useState, useSyncExternalStore } from "react";
import { BASE } from "../wire/address";
import { keepText, keptNames, readKept } from "../wire/browserStorage";
import { sessionQuery } from "./queries";

/** A value that a person changes while the service may change it too. Pure. */

export type Draft =
  | { readonly kind: "following" }
  | { readonly kind: "editing"; readonly value: number }
  | { readonly kind: "sent"; readonly value: number };

export type DraftEvent =
  | { readonly kind: "edit"; readonly value: number }
  | { readonly kind: "send"; readonly value: number }
  | { readonly kind: "read-back" }
  | { readonly kind: "drop" };

export const FOLLOWING: Draft = { kind: "following" };

/**
 * What the control shows next. A value sent stays in sight until the service reports what is in force; one that is being
 * edited is not overwritten by reports.
 */
export function nextDraft(draft: Draft, event: DraftEvent): Draft {
  switch (event.kind) {
    case "edit":
      return { kind: "editing", value: event.value };
    case "send":
      return { kind: "sent", value: event.value };
    case "read-back":
      return draft.kind === "sent" ? FOLLOWING : draft;
    case "drop":
      return FOLLOWING;
  }
}

export function shown(draft: Draft, inForce: number): number {
  return draft.kind === "following" ? inForce : draft.value;
}

/**
 * Stores drafts in the browser: what a person has typed and not yet saved, sent or started. A draft survives leaving the
 * page and a reload. It belongs to one person at one station. Where the browser stores nothing, the draft is held in
 * memory: it survives leaving the page, not a reload.
 */

/** Version of the stored form. A draft of another version is not read. */
const FORMAT = 1;
const PREFIX = "sinew-draft";

export interface KeptDraft {
  readonly value: unknown;
  /** When the first change was made, as an ISO 8601 text. */
  readonly since: string;
}

/** Whose draft it is, and of which form. Until the person is known, a draft is held in memory. */
export interface DraftOf {
  readonly person: string | undefined;
  readonly form: string;
}

const inMemory = new Map<string, string>();
const listeners = new Set<() => void>();

/** The stored text of a draft, null where there is none. */
export function storedDraft(of: DraftOf): string | null {
  const unclaimed = inMemory.get(of.form) ?? null;
  if (of.person === undefined) return unclaimed;
  const key = keyOf(of);
  return inMemory.get(key) ?? readKept("localStorage", key) ?? unclaimed;
}

/** Whether a draft survives a reload. */
export function isStored(of: DraftOf): boolean {
  return !inMemory.has(keyOf(of));
}

/** Store the draft that was typed before the person was known, unless the person has one. */
export function claimDraft(of: DraftOf): void {
  if (of.person === undefined || !inMemory.has(of.form)) return;
  put(of, storedDraft(of));
}

/** Parse a stored draft. Returns null for none, for one of another version and for what is no draft. */
export function draftIn(text: string | null): KeptDraft | null {
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
export function keepDraft(of: DraftOf, value: unknown): void {
  const since = draftIn(storedDraft(of))?.since ?? new Date().toISOString();
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
  for (const key of [...keptNames("localStorage"), ...inMemory.keys()]) {
    if (!key.startsWith(beginning)) continue;
    const form = key.slice(beginning.length);
    const to = { person: after, form };
    if (storedDraft(to) === null) put(to, storedDraft({ person: before, form }));
  }
}

function put(of: DraftOf, text: string | null): void {
  const key = keyOf(of);
  inMemory.delete(of.form);
  inMemory.delete(key);
  const isKept = of.person !== undefined && keepText("localStorage", key, text);
  if (!isKept && text !== null) inMemory.set(key, text);
  for (const listener of listeners) listener();
}

/** Who is there twice has a number behind the name, which is another one the next time. */
function keyOf({ person, form }: DraftOf): string {
  return person === undefined ? form : `${PREFIX} ${BASE} ${person.replace(/ \(\d+\)$/, "")} ${form}`;
}

/** The values of a form that survive leaving the page and a reload, until they are saved, sent or discarded. */

export interface FormDraft<T> {
  /** The draft, or the initial value where there is none. */
  readonly value: T;
  /** When the first change was made; null while the form shows the initial value. */
  readonly since: string | null;
  /** Whether the draft survives a reload. */
  readonly stored: boolean;
  /** Takes a value, or a function of the newest one. The initial value is no draft. */
  set(next: T | ((before: T) => T)): void;
  discard(): void;
}

/**
 * Args:
 *   form: name of the form, part of the key under which the browser stores the draft.
 *   initial: value without a draft; JSON data.
 *   isValid: whether stored data is a value of this form. An older version of the page may have stored other data.
 */
export function useDraft<T>(form: string, initial: T, isValid: (value: unknown) => value is T): FormDraft<T> {
  const person = useQuery(sessionQuery).data?.name;
  const of = { person, form };
  const text = useSyncExternalStore(watchDrafts, () => storedDraft(of));
  useEffect(() => claimDraft({ person, form }), [person, form]);
  const kept = useMemo(() => draftIn(text), [text]);
  const isDraft = kept !== null && isValid(kept.value);
  return {
    value: isDraft ? (kept.value as T) : initial,
    since: isDraft ? kept.since : null,
    stored: isStored(of),
    set: (next) => {
      const newest = draftIn(storedDraft(of))?.value;
      const before = isValid(newest) ? newest : initial;
      const value = typeof next === "function" ? (next as (before: T) => T)(before) : next;
      keepDraft(of, JSON.stringify(value) === JSON.stringify(initial) ? null : value);
    },
    discard: () => keepDraft(of, null),
  };
}

/** Whether stored data is a record of plain values, as the settings of a form are. */
export function isPlainRecord(value: unknown): value is Record<string, boolean | number | string> {
  return (
    typeof value === "object" &&
    value !== null &&
    !Array.isArray(value) &&
    Object.values(value).every((one) => ["boolean", "number", "string"].includes(typeof one))
  );
}

/** A box of a number keeps a text that is no number yet. */
export function isNumberOrText(value: unknown): value is number | string {
  return typeof value === "number" || typeof value === "string";
}

export function isText(value: unknown): value is string {
  return typeof value === "string";
}

/** A number that is edited here, sent on release, and read back from the service. */

/** Longest wait for the report after an accepted value that changed nothing. */
const READ_BACK_MS = 1200;

export interface SentValue {
  /** What to show: the draft while there is one, else what is in force. */
  readonly value: number;
  readonly editing: boolean;
  readonly pending: boolean;
  /** Why the last value was refused; null once the next one is tried. */
  readonly refusal: Error | null;
  edit(value: number): void;
  commit(value: number): void;
  cancel(): void;
}

export function useSentValue(inForce: number, send: (value: number) => Promise<unknown>): SentValue {
  const [draft, happen] = useReducer(nextDraft, FOLLOWING);
  const [refusal, setRefusal] = useState<Error | null>(null);
  const [pending, setPending] = useState(false);
  const busy = useRef(false);
  const waiting = useRef<number | null>(null);

  // biome-ignore lint/correctness/useExhaustiveDependencies: each report counts as read back, whatever its value
  useEffect(() => {
    if (!busy.current) happen({ kind: "read-back" });
  }, [inForce]);

  useEffect(() => {
    if (draft.kind !== "sent" || pending) return;
    const timer = window.setTimeout(() => happen({ kind: "read-back" }), READ_BACK_MS);
    return () => window.clearTimeout(timer);
  }, [draft, pending]);

  async function deliver(value: number): Promise<void> {
    busy.current = true;
    setPending(true);
    try {
      await send(value);
      setRefusal(null);
    } catch (error) {
      setRefusal(error instanceof Error ? error : new Error(String(error)));
      if (waiting.current === null) happen({ kind: "drop" });
    }
    busy.current = false;
    const next = waiting.current;
    waiting.current = null;
    if (next === null) setPending(false);
    else await deliver(next);
  }

  return {
    value: shown(draft, inForce),
    editing: draft.kind === "editing",
    pending,
    refusal,
    edit: (value) => happen({ kind: "edit", value }),
    commit: (value) => {
      happen({ kind: "send", value });
      if (busy.current) waiting.current = value;
      else void deliver(value);
    },
    cancel: () => happen({ kind: "drop" }),
  };
}
