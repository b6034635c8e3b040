/** A refusal stands at the field it speaks of: each field of a form asks here whether it is the one. */

import { createContext, type ReactNode, useContext, useEffect, useMemo, useRef } from "react";
import { inWords } from "../samples/quantity";
import { RequestError } from "../wire/client";
import { useAngles } from "./angles";
import { useStanding } from "./useStanding";

interface Refused {
  /** Place of the field to blame: one that is on the page; null where there is none. */
  readonly place: string | null;
  readonly text: string;
  readonly error: Error | null;
  readonly places: Set<string>;
}

const Context = createContext<Refused>({ place: null, text: "", error: null, places: new Set() });

interface RefusedFieldsProps {
  readonly error: Error | null | undefined;
  /** What the refused request would have changed: once that changes, the refusal is over. */
  readonly about?: unknown;
  readonly children: ReactNode;
}

export function RefusedFields({ error, about, children }: RefusedFieldsProps) {
  const places = useRef(new Set<string>()).current;
  const angles = useAngles();
  const standing = useStanding(error, about);
  const path = standing instanceof RequestError ? (standing.problem?.path?.join(".") ?? null) : null;
  const refused = useMemo(() => {
    const place = path === null ? null : placeIn(path, places);
    return {
      place,
      text: standing === null ? "" : inWords(standing.message, angles),
      error: standing,
      places,
    };
  }, [path, standing, angles, places]);
  return <Context value={refused}>{children}</Context>;
}

/** Why the value at this place is refused; null where it is not. `place` as in "q_amplitude", "segments.2.q_ref". */
export function useRefusedField(place: string | undefined): { text: string; error: Error | null } | null {
  const { place: blamed, text, error, places } = useContext(Context);
  useEffect(() => {
    if (place === undefined) return;
    places.add(place);
    return () => {
      places.delete(place);
    };
  }, [place, places]);
  return place !== undefined && place === blamed ? { text, error } : null;
}

/** Why something within this place is refused, for what speaks for several fields; null where nothing is. */
export function useRefusedWithin(place: string): string | null {
  const { place: blamed, text } = useContext(Context);
  return blamed?.startsWith(`${place}.`) ? text : null;
}

/** Whether this refusal is told at a field already. */
export function useToldAtField(error: Error | null): boolean {
  const { place, error: told } = useContext(Context);
  return place !== null && error !== null && told === error;
}

/** The field that a path speaks of: its own, or the list that it lies in. */
function placeIn(path: string, places: ReadonlySet<string>): string | null {
  const names = path.split(".");
  for (let length = names.length; length > 0; length -= 1) {
    for (let from = 0; from < length; from += 1) {
      const place = names.slice(from, length).join(".");
      if (places.has(place)) return place;
    }
  }
  return null;
}

interface Attempt {
  readonly error: Error | null;
  readonly submittedAt: number;
}

/** The refusal of the last attempt; one that went through ends the refusals before it. */
export function lastRefusal(...attempts: readonly Attempt[]): Error | null {
  return attempts.reduce((last, attempt) => (attempt.submittedAt > last.submittedAt ? attempt : last)).error;
}
