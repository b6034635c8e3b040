/** Values of forms that are being edited: drafts that survive a reload, and numbers sent on release. */

import { useQuery } from "@tanstack/react-query";
import { useEffect, useMemo, useReducer, useRef, useState, useSyncExternalStore } from "react";
import { sessionQuery } from "../api/session";
import { claimDraft, isStored, parseDraft, storeDraft, storedDraft, watchDrafts } from "./draftStorage";

/** A value that a person changes while the service may change it too. Pure. */

type Draft =
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
  const kept = useMemo(() => parseDraft(text), [text]);
  const isDraft = kept !== null && isValid(kept.value);
  return {
    value: isDraft ? (kept.value as T) : initial,
    since: isDraft ? kept.since : null,
    stored: isStored(of),
    set: (next) => {
      const newest = parseDraft(storedDraft(of))?.value;
      const before = isValid(newest) ? newest : initial;
      const value = typeof next === "function" ? (next as (before: T) => T)(before) : next;
      storeDraft(of, JSON.stringify(value) === JSON.stringify(initial) ? null : value);
    },
    discard: () => storeDraft(of, null),
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

interface SentValue {
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
