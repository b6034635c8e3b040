import { createContext, type ReactNode, type RefObject, useContext, useEffect, useMemo, useRef } from "react";
import { inWords } from "../samples/quantity";
import { RequestError } from "../wire/client";
import { useErrorLifetime } from "./control";
import { useAngles } from "./preferences";

/** Mantine names what describes its own inputs; here another element is named, for as long as there is one. */

export function useDescribedBy(input: RefObject<HTMLElement | null>, id: string | undefined): void {
  useEffect(() => {
    const element = input.current;
    if (id === undefined || element === null) return;
    const before = element.getAttribute("aria-describedby");
    element.setAttribute("aria-describedby", [before, id].filter(Boolean).join(" "));
    return () => {
      if (before === null) element.removeAttribute("aria-describedby");
      else element.setAttribute("aria-describedby", before);
    };
  }, [input, id]);
}

/** A refusal stands at the field it speaks of: each field of a form asks here whether it is the one. */

interface Refused {
  /** Place of the field to blame: one that is on the page; null where there is none. */
  readonly place: string | null;
  readonly text: string;
  readonly error: Error | null;
  /** Whether the person asked for what was refused. */
  readonly asked: boolean;
  readonly places: Set<string>;
}

const Context = createContext<Refused>({
  place: null,
  text: "",
  error: null,
  asked: false,
  places: new Set(),
});

interface RefusedFieldsProps {
  readonly error: Error | null | undefined;
  /** A refusal that nobody asked for, as of a forecast: its field is marked, and whoever types is left where they are. */
  readonly foreseen?: Error | null | undefined;
  /** The one field there is: a refused value that names no field is its value. */
  readonly only?: string;
  /** What the refused request would have changed: once that changes, the refusal is over. */
  readonly about?: unknown;
  readonly children: ReactNode;
}

export function RefusedFields({ error, foreseen, about, only, children }: RefusedFieldsProps) {
  const places = useRef(new Set<string>()).current;
  const angles = useAngles();
  const answered = useErrorLifetime(error, about);
  const standing = answered ?? foreseen ?? null;
  const refused = useMemo(() => {
    const path = standing instanceof RequestError ? standing.problem?.path?.join(".") : undefined;
    const place = path === undefined ? null : placeIn(path, places);
    return {
      place: place ?? (only !== undefined && isOfValue(standing) ? only : null),
      text: standing === null ? "" : inWords(standing.message, angles),
      error: standing,
      asked: answered !== null,
      places,
    };
  }, [standing, answered, only, angles, places]);
  return <Context value={refused}>{children}</Context>;
}

interface RefusedInput<Input extends HTMLElement> {
  readonly ref: RefObject<Input | null>;
  /** Why the value is refused; null where it is not. */
  readonly said: string | null;
}

/**
 * What any input needs of the refusals of its form: the ref by which it is opened, gone to, and described by `saidAt`,
 * the element that says why where the input does not say so itself. `place` as in "q_amplitude", "segments.2.q_ref".
 */
export function useRefusedInput<Input extends HTMLElement>(
  place: string | undefined,
  saidAt?: string,
): RefusedInput<Input> {
  const { place: blamed, text, error, asked, places } = useContext(Context);
  const ref = useRef<Input>(null);
  useEffect(() => {
    if (place === undefined) return;
    places.add(place);
    return () => {
      places.delete(place);
    };
  }, [place, places]);
  const refused = place !== undefined && place === blamed;
  const cause = refused && asked ? error : null;
  useEffect(() => {
    if (cause === null) return;
    ref.current?.closest("details")?.setAttribute("open", "");
    ref.current?.focus();
  }, [cause]);
  useDescribedBy(ref, refused ? saidAt : undefined);
  return { ref, said: refused ? text : null };
}

/**
 * Why something within this place is refused, for what speaks for several fields; null where nothing is, and where it is
 * within one of those that speak for themselves.
 */
export function useRefusedWithin(place: string, others: readonly string[] = []): string | null {
  const { place: blamed, text } = useContext(Context);
  const within = (outer: string) => blamed?.startsWith(`${outer}.`) ?? false;
  return within(place) && !others.some(within) ? text : null;
}

/** Whether this refusal is told at a field already. */
export function useToldAtField(error: Error | null): boolean {
  const { place, error: told } = useContext(Context);
  return place !== null && error !== null && told === error;
}

/** Whether it is a value that was refused, and not the moment, the person or the way to the service. */
function isOfValue(error: Error | null): boolean {
  return error instanceof RequestError && [400, 413, 422].includes(error.status);
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
