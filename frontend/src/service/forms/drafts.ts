/** Edited values of forms: drafts that survive a reload, and numbers that the page sends on release. */

import { useQuery } from "@tanstack/react-query";
import { useEffect, useMemo, useReducer, useRef, useState, useSyncExternalStore } from "react";
import { sessionQuery } from "../api/session";
import { claimDraft, isStored, parseDraft, storeDraft, storedDraft, watchDrafts } from "./draftStorage";

/** A value that a person and the service may change at the same time. */

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
 * Returns the draft after an event. A sent value remains visible until the service reports the active one; reports do
 * not overwrite an edited value.
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

export function shown(draft: Draft, active: number): number {
  return draft.kind === "following" ? active : draft.value;
}

/** Values of a form that survive a change of the page and a reload, until they are saved, sent or discarded. */

export interface FormDraft<T> {
  /** The draft, or the initial value without one. */
  readonly value: T;
  /** Time of the first change; null while the form shows the initial value. */
  readonly since: string | null;
  /** Whether the draft survives a reload. */
  readonly stored: boolean;
  /** Sets a value, or the result of a function of the newest one. The initial value removes the draft. */
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
  const draft = useMemo(() => parseDraft(text), [text]);
  const isDraft = draft !== null && isValid(draft.value);
  return {
    value: isDraft ? (draft.value as T) : initial,
    since: isDraft ? draft.since : null,
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

/** Whether stored data is a record of plain values, such as the settings of a form. */
export function isPlainRecord(value: unknown): value is Record<string, boolean | number | string> {
  return (
    typeof value === "object" &&
    value !== null &&
    !Array.isArray(value) &&
    Object.values(value).every((one) => ["boolean", "number", "string"].includes(typeof one))
  );
}

/** Whether stored data is the value of a number box, which may contain text that is not a number yet. */
export function isNumberOrText(value: unknown): value is number | string {
  return typeof value === "number" || typeof value === "string";
}

export function isText(value: unknown): value is string {
  return typeof value === "string";
}

/** Longest wait for the report after an accepted value [ms]: a value that changes nothing has no report. */
const READ_BACK_MS = 1200;

interface SentValue {
  /** Value to show: the draft, or the active value without one. */
  readonly value: number;
  readonly editing: boolean;
  readonly pending: boolean;
  /** Refusal of the last value; null after the service accepts another one. */
  readonly refusal: Error | null;
  edit(value: number): void;
  commit(value: number): void;
  cancel(): void;
}

export function useSentValue(active: number, send: (value: number) => Promise<unknown>): SentValue {
  const [draft, dispatch] = useReducer(nextDraft, FOLLOWING);
  const [refusal, setRefusal] = useState<Error | null>(null);
  const [pending, setPending] = useState(false);
  const busy = useRef(false);
  const waiting = useRef<number | null>(null);

  // biome-ignore lint/correctness/useExhaustiveDependencies: each report counts as read back, whatever its value
  useEffect(() => {
    if (!busy.current) dispatch({ kind: "read-back" });
  }, [active]);

  useEffect(() => {
    if (draft.kind !== "sent" || pending) return;
    const timer = window.setTimeout(() => dispatch({ kind: "read-back" }), READ_BACK_MS);
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
      if (waiting.current === null) dispatch({ kind: "drop" });
    }
    busy.current = false;
    const next = waiting.current;
    waiting.current = null;
    if (next === null) setPending(false);
    else await deliver(next);
  }

  return {
    value: shown(draft, active),
    editing: draft.kind === "editing",
    pending,
    refusal,
    edit: (value) => dispatch({ kind: "edit", value }),
    commit: (value) => {
      dispatch({ kind: "send", value });
      if (busy.current) waiting.current = value;
      else void deliver(value);
    },
    cancel: () => dispatch({ kind: "drop" }),
  };
}
