/** Refusals of the service: the time for which the page shows one, and its field. */

import {
  createContext,
  type ReactNode,
  type RefObject,
  useContext,
  useEffect,
  useMemo,
  useRef,
  useState,
  useSyncExternalStore,
} from "react";
import { useLive } from "../../live/react";
import type { Live } from "../../live/store";
import { localizeText } from "../../samples/quantity";
import { RequestError } from "../../wire/client";
import { heldEpoch, watchHeld } from "../../wire/control";
import { useAngleUnit } from "../api/preferences";

/** Cause of a refusal: the page hides the refusal when its cause no longer applies. */
type Cause = "control" | "link" | "moment" | "value";

/** A refusal with its circumstances. */
interface ShownError {
  readonly error: Error | null;
  readonly circumstances: string;
  readonly since_ms: number;
  readonly over: boolean;
}

const NO_ERROR: ShownError = { error: null, circumstances: "", since_ms: 0, over: true };

/** The state that belongs to a refusal may arrive after it; changes within this time [ms] do not hide the refusal. */
const SETTLE_MS = 600;

/** Whether a request was refused because of the control lease: taking control is the remedy. */
export function isAboutControl(error: Error | null): boolean {
  return error instanceof RequestError && error.problem?.code.startsWith("control_") === true;
}

function causeOf(error: Error): Cause {
  if (!(error instanceof RequestError)) return "value";
  if (error.status === 0) return "link";
  if (isAboutControl(error)) return "control";
  return error.status === 409 || error.status === 503 ? "moment" : "value";
}

/**
 * Returns the circumstances under which the refusal remains valid. `epoch` is that of this page's control lease, `about`
 * the active value that the refused request would have changed.
 */
function circumstances(error: Error, live: Live, epoch: number | null, about: unknown): string {
  const { state, link } = live;
  switch (causeOf(error)) {
    case "control":
      return JSON.stringify([epoch, state?.holder?.epoch]);
    case "link":
      return JSON.stringify([link.opened_ms, about]);
    case "moment":
      return JSON.stringify([
        state?.mode,
        state?.fault?.code,
        state?.task?.run,
        state?.trial === null,
        state?.pretension_done,
        state?.link.starts,
        about,
      ]);
    case "value":
      return JSON.stringify(about ?? null);
  }
}

/** Returns the next state of a refusal; a hidden one remains hidden. */
function nextShownError(before: ShownError, error: Error | null, now: string, now_ms: number): ShownError {
  if (error !== before.error) return { error, circumstances: now, since_ms: now_ms, over: error === null };
  if (before.over || now === before.circumstances) return before;
  if (now_ms - before.since_ms < SETTLE_MS) return { ...before, circumstances: now };
  return { ...before, over: true };
}

/** Returns `error` while its cause applies; `about` is the active value that the request would have changed. */
export function useErrorLifetime(error: Error | null | undefined, about?: unknown): Error | null {
  const epoch = useSyncExternalStore(watchHeld, heldEpoch);
  const refused = error ?? null;
  const now = useLive((live) => (refused === null ? "" : circumstances(refused, live, epoch, about)));
  const [before, setBefore] = useState(NO_ERROR);
  const current = nextShownError(before, refused, now, performance.now());
  if (current !== before) setBefore(current);
  return current.over ? null : refused;
}

/** Adds an element to those that describe an input, beyond the ones that Mantine adds. */

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

/** Refusal of a form; each field compares its place with that of the refusal. */

interface Refused {
  /** Place of the refused field; null if no field of the page has that place. */
  readonly place: string | null;
  readonly text: string;
  readonly error: Error | null;
  /** Whether a person made the refused request. */
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
  /** A refusal of a request that the page made, such as a prediction: its field is marked, and the focus does not move. */
  readonly foreseen?: Error | null | undefined;
  /** Place of the only field: a refused value without a place belongs to it. */
  readonly only?: string;
  /** Value that the refused request would have changed: when it changes, the refusal is hidden. */
  readonly about?: unknown;
  readonly children: ReactNode;
}

export function RefusedFields({ error, foreseen, about, only, children }: RefusedFieldsProps) {
  const places = useRef(new Set<string>()).current;
  const angles = useAngleUnit();
  const answered = useErrorLifetime(error, about);
  const shown = answered ?? foreseen ?? null;
  const refused = useMemo(() => {
    const path = shown instanceof RequestError ? shown.problem?.path?.join(".") : undefined;
    const place = path === undefined ? null : placeIn(path, places);
    return {
      place: place ?? (only !== undefined && isOfValue(shown) ? only : null),
      text: shown === null ? "" : localizeText(shown.message, angles),
      error: shown,
      asked: answered !== null,
      places,
    };
  }, [shown, answered, only, angles, places]);
  return <Context value={refused}>{children}</Context>;
}

interface RefusedInput<Input extends HTMLElement> {
  readonly ref: RefObject<Input | null>;
  /** Reason of the refusal of the value; null if it is not refused. */
  readonly said: string | null;
}

/**
 * Connects an input with the refusals of its form: the ref serves to show and focus the input, and to describe it by the
 * element `messageId`, if that element shows the reason. `place` as in "q_amplitude", "phases.0.parts.2.q_ref".
 */
export function useRefusedInput<Input extends HTMLElement>(
  place: string | undefined,
  messageId?: string,
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
  useDescribedBy(ref, refused ? messageId : undefined);
  return { ref, said: refused ? text : null };
}

/**
 * Returns the reason of a refusal within this place, for an element that shows it for several fields; null if there is
 * none, or if it is within one of `others`, which show their own.
 */
export function useRefusedWithin(place: string, others: readonly string[] = []): string | null {
  const { place: blamed, text } = useContext(Context);
  const within = (outer: string) => blamed?.startsWith(`${outer}.`) ?? false;
  return within(place) && !others.some(within) ? text : null;
}

/** Whether a field shows this refusal. */
export function useShownAtField(error: Error | null): boolean {
  const { place, error: refused } = useContext(Context);
  return place !== null && error !== null && refused === error;
}

/** Whether the service refused a value, and not for its state, the person or the connection. */
function isOfValue(error: Error | null): boolean {
  return error instanceof RequestError && [400, 413, 422].includes(error.status);
}

/** Returns the field of a path, or the list that contains it. */
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

/** Returns the refusal of the last attempt; null if it succeeded. */
export function lastRefusal(...attempts: readonly Attempt[]): Error | null {
  return attempts.reduce((last, attempt) => (attempt.submittedAt > last.submittedAt ? attempt : last)).error;
}
