/** A number that is edited here, sent on release, and read back from the service. */

import { useEffect, useReducer, useRef, useState } from "react";
import { FOLLOWING, nextDraft, shown } from "./draft";

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
