/**
 * References are sent in pairs, and a person orders one of them: the other one goes along as it was ordered last, for
 * the state that tells it may still be on its way.
 */

import { useEffect, useRef } from "react";
import type { References } from "../wire/types";
import { useSetReferences } from "./commands";

/** The state tells within this time what was accepted [ms]; after it what is in force counts again. */
const TOLD_WITHIN_MS = 1200;

interface Ordered extends References {
  readonly at_ms: number;
}

/** Sends a part of the references, after what was ordered before has been answered; rejects where it is refused. */
export function useReferenceOrders(inForce: References): (part: Partial<References>) => Promise<void> {
  const { mutateAsync } = useSetReferences();
  const known = useRef(inForce);
  const ordered = useRef<Ordered | null>(null);
  const last = useRef<Promise<void>>(Promise.resolve());
  useEffect(() => {
    known.current = inForce;
  }, [inForce]);

  async function order(part: Partial<References>): Promise<void> {
    const before = ordered.current;
    const isFresh = before !== null && performance.now() - before.at_ms < TOLD_WITHIN_MS;
    const { q_ref, S_ref } = isFresh ? before : known.current;
    const wanted = { q_ref, S_ref, ...part };
    await mutateAsync(wanted);
    ordered.current = { ...wanted, at_ms: performance.now() };
  }

  return (part) => {
    const mine = last.current.then(() => order(part));
    last.current = mine.catch(() => undefined);
    return mine;
  };
}
