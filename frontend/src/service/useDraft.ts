/** The values of a form that survive leaving the page and a reload, until they are saved, sent or discarded. */

import { useQuery } from "@tanstack/react-query";
import { useEffect, useMemo, useSyncExternalStore } from "react";
import { claimDraft, draftIn, isStored, keepDraft, storedDraft, watchDrafts } from "./keptDraft";
import { sessionQuery } from "./queries";

export interface Draft<T> {
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
export function useDraft<T>(form: string, initial: T, isValid: (value: unknown) => value is T): Draft<T> {
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
