/** Refusals of the service: how long one is shown, and at which field. */

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

/** How long a refusal stands: each has a cause, and the message goes when its cause does. Pure. */

/** What a refusal is about, and so what ends it. */
type Cause = "control" | "link" | "moment" | "value";

/** A refusal with the circumstances in which it was given. */
interface ShownError {
  readonly error: Error | null;
  readonly circumstances: string;
  readonly since_ms: number;
  readonly over: boolean;
}

const NO_ERROR: ShownError = { error: null, circumstances: "", since_ms: 0, over: true };

/** The state that belongs to a refusal may come after it; what changes by then is no end. */
const SETTLE_MS = 600;

/** Whether a request was refused for who holds control: taking control is the remedy. */
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
 * What has to stay as it is for the refusal to hold. `epoch` is the control that this page holds, `about` what the
 * refused request would have changed, as it is in force.
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

/** The refusal as it stands now; one that is over does not come back, whatever returns. */
function nextShownError(before: ShownError, error: Error | null, now: string, now_ms: number): ShownError {
  if (error !== before.error) return { error, circumstances: now, since_ms: now_ms, over: error === null };
  if (before.over || now === before.circumstances) return before;
  if (now_ms - before.since_ms < SETTLE_MS) return { ...before, circumstances: now };
  return { ...before, over: true };
}

/** A refusal for as long as its cause lasts. */

/** `error` until what caused it is gone; `about` is what the request would have changed, as it is in force. */
export function useErrorLifetime(error: Error | null | undefined, about?: unknown): Error | null {
  const epoch = useSyncExternalStore(watchHeld, heldEpoch);
  const refused = error ?? null;
  const now = useLive((live) => (refused === null ? "" : circumstances(refused, live, epoch, about)));
  const [before, keep] = useState(NO_ERROR);
  const standing = nextShownError(before, refused, now, performance.now());
  if (standing !== before) keep(standing);
  return standing.over ? null : refused;
}

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
  const angles = useAngleUnit();
  const answered = useErrorLifetime(error, about);
  const standing = answered ?? foreseen ?? null;
  const refused = useMemo(() => {
    const path = standing instanceof RequestError ? standing.problem?.path?.join(".") : undefined;
    const place = path === undefined ? null : placeIn(path, places);
    return {
      place: place ?? (only !== undefined && isOfValue(standing) ? only : null),
      text: standing === null ? "" : localizeText(standing.message, angles),
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
 * What any input needs of the refusals of its form: the ref by which it is opened, gone to, and described by `messageId`,
 * the element that says why where the input does not say so itself. `place` as in "q_amplitude", "phases.0.parts.2.q_ref".
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
 * Why something within this place is refused, for what speaks for several fields; null where nothing is, and where it is
 * within one of those that speak for themselves.
 */
export function useRefusedWithin(place: string, others: readonly string[] = []): string | null {
  const { place: blamed, text } = useContext(Context);
  const within = (outer: string) => blamed?.startsWith(`${outer}.`) ?? false;
  return within(place) && !others.some(within) ? text : null;
}

/** Whether this refusal is told at a field already. */
export function useShownAtField(error: Error | null): boolean {
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
