/** Notifies the person of events while the page is hidden, according to the preferences. */

import { useEffect, useEffectEvent } from "react";
import { useLocation } from "wouter";
import { useLiveStore } from "../../live/react";
import { heading, spacedName } from "../../samples/format";
import { type AngleUnit, localizeText } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { answered, api, RequestError } from "../../wire/client";
import { PERIOD_S } from "../../wire/sample.gen";
import type { Fault, Flight, Run, State, Task } from "../../wire/types";
import { usePreferences } from "../api/preferences";
import { TEXTS } from "../texts";
import { announceVisibility, type PageNotification, showNotification } from "./notifications";

interface Trip {
  readonly kind: "trip";
  readonly fault: Fault;
  /** Number of the start of the loop from which the fault's tick counts. */
  readonly starts: number;
}

type PageEvent = Trip | { readonly kind: "over"; readonly run: Task["run"] };

export class EventDetector {
  private before: State | null = null;
  /** The run whose end was reported last: the state still names it during the pause that follows. */
  private over: Task["run"] | null = null;

  /** Returns the events of a state; none for the first state, and none during a replay. */
  detect(state: State): PageEvent[] {
    const { before } = this;
    this.before = state;
    if (before === null) this.over = isPaused(state.task) ? state.task.run : null;
    if (before === null || state.plant.kind === "replay") return [];
    const found: PageEvent[] = [];
    if (state.fault !== null && !state.fault.expected && !isSame(before, state)) {
      found.push({ kind: "trip", fault: state.fault, starts: state.link.starts });
    }
    const run = before.task?.run ?? null;
    if (run !== null && run !== this.over && (run !== state.task?.run || isPaused(state.task))) {
      found.push({ kind: "over", run });
      this.over = run;
    }
    return found;
  }
}

function isPaused(task: Task | null): task is Task {
  return task?.phase === "paused";
}

function isSame(before: State, state: State): boolean {
  return before.link.starts === state.link.starts && before.fault?.tick === state.fault?.tick;
}

/** Largest error of the clock comparison [ms]: the header has whole seconds, and the answer takes time. */
const NEAR_MS = 3000;
const PERIOD_MS = 1000 * PERIOD_S;

/** Returns the age of a trip [ms] at a later state; null if the loop has restarted since. */
function ageOf({ fault, starts }: Trip, state: State | null): number | null {
  if (state === null || state.link.starts !== starts || state.tick < fault.tick) return null;
  return (state.tick - fault.tick) * PERIOD_MS;
}

/**
 * Returns the record of a trip at `at_ms` by the service's clock. Successive trips share the record of the first one.
 * The time excludes records of other loop processes, whose ticks restart.
 */
function recordOf(flights: readonly Flight[], { fault }: Trip, at_ms: number): Flight | undefined {
  const apart = flights.flatMap((flight) => {
    if (flight.kind !== "trip") return [];
    const after_ms = (fault.tick - flight.tick) * PERIOD_MS;
    if (after_ms < 0 || after_ms > 1000 * flight.after_s) return [];
    return [{ flight, ms: Math.abs(Date.parse(flight.at) + after_ms - at_ms) }];
  });
  return apart.filter(({ ms }) => ms <= NEAR_MS).sort((a, b) => a.ms - b.ms)[0]?.flight;
}

type EventText = Omit<PageNotification, "open">;

/** Describes a finished run: its kind, number, end state and title, and the reason of an incomplete run. */
export function describeRun({ id, kind, title, end_state, end_reason }: Run, angles: AngleUnit): EventText {
  const more = end_state === "completed" ? [title] : [title, end_reason];
  return {
    tag: `sinew-run-${id}`,
    title: fillText(TEXTS.runOver, { kind: heading(kind), run: id, state: spacedName(end_state) }),
    body: localizeText(more.filter((part) => part !== "").join(" · "), angles),
  };
}

const STOP: Fault["code"] = "stop_pressed";

/** Describes a trip with its cause and remedy. A STOP is called a stop, not a trip. */
export function describeTrip({ fault, starts }: Trip, angles: AngleUnit): EventText {
  return {
    tag: `sinew-trip-${starts}-${fault.tick}`,
    title: fault.code === STOP ? TEXTS.stopped : fillText(TEXTS.tripped, { fault: spacedName(fault.code) }),
    body: localizeText(`${fault.message} ${fault.remedy}`, angles),
  };
}

/** A flight record becomes available after the seconds that follow its trip. */
const POLLS = 20;
const POLL_MS = 500;
/** Time until the next request for a run [ms]: while its last samples are being stored, and after a failure. */
const AGAIN_MS = 500;
const AFTER_FAILURE_MS = 5000;

export function useNotifications(): void {
  const store = useLiveStore();
  const { preferences } = usePreferences();
  const { notify, sound, angles } = preferences;
  const [, go] = useLocation();
  const channels = { notification: notify, sound };
  const wanted = notify || sound;

  const notifyOfTrip = useEffectEvent((trip: Trip) => {
    if (!wanted) return;
    const received_ms = Date.now() - (ageOf(trip, store.snapshot().state) ?? 0);
    const open = () => {
      const age_ms = ageOf(trip, store.snapshot().state); // the state at the click: a suspended tab received the trip late
      void openFlight(trip, age_ms === null ? received_ms : Date.now() - age_ms, go);
    };
    void showNotification({ ...describeTrip(trip, angles), open }, channels);
  });
  /** Notifies of the end of a run; returns false if the run has not ended yet. */
  const notifyOfRun = useEffectEvent(async (id: number): Promise<boolean> => {
    if (!wanted) return true;
    const run = await answered(api.GET("/api/runs/{id}", { params: { path: { id } } }));
    if (run.end_state === "running") return false; // its last samples are being stored
    await showNotification({ ...describeRun(run, angles), open: () => go(`/runs/${id}`) }, channels);
    return true;
  });

  useEffect(announceVisibility, []);
  useEffect(() => {
    const detector = new EventDetector();
    const over = new Set<number>();
    const notBefore = new Map<number, number>();
    let lastState: State | null = null;

    function checkRun(id: number): void {
      if (performance.now() < (notBefore.get(id) ?? 0)) return;
      notBefore.set(id, Number.POSITIVE_INFINITY); // during the request
      const again = (in_ms: number) => notBefore.set(id, performance.now() + in_ms);
      notifyOfRun(id)
        .then((done) => (done ? over.delete(id) : again(AGAIN_MS)))
        .catch((error) => (isFinal(error) ? over.delete(id) : again(AFTER_FAILURE_MS)));
    }

    function onState(): void {
      const { state } = store.snapshot();
      if (state === null || state === lastState) return;
      lastState = state;
      for (const event of detector.detect(state)) handle(event);
      for (const id of over) checkRun(id);
    }

    function handle(event: PageEvent): void {
      if (event.kind === "trip") notifyOfTrip(event);
      else over.add(event.run);
    }

    onState();
    return store.subscribe(onState);
  }, [store]);
}

/** Whether a further request would fail in the same way: the object does not exist, or is not permitted. */
function isFinal(error: unknown): boolean {
  return error instanceof RequestError && error.status >= 400 && error.status < 500 && error.status !== 429;
}

/** Fetches the flight records, and the lead of the service's clock over this page's [ms]. */
async function flightsNow(): Promise<{ flights: readonly Flight[]; ahead_ms: number }> {
  const from_ms = Date.now();
  const request = api.GET("/api/flights");
  const { flights } = await answered(request);
  const date = Date.parse((await request).response.headers.get("Date") ?? "");
  // the header has whole seconds, and the time of the answer lies between request and response
  const ahead_ms = Number.isNaN(date) ? 0 : date + 500 - (from_ms + Date.now()) / 2;
  return { flights, ahead_ms };
}

/** Opens the record of a trip at `at_ms` by the page's clock; the log if there is none. */
async function openFlight(trip: Trip, at_ms: number, go: (path: string) => void): Promise<void> {
  for (let poll = 0; poll < POLLS; poll++) {
    try {
      const { flights, ahead_ms } = await flightsNow();
      const flight = recordOf(flights, trip, at_ms + ahead_ms);
      if (flight !== undefined) {
        go(`/flights/${flight.id}`);
        return;
      }
    } catch (error) {
      if (isFinal(error)) break;
    }
    await new Promise((later) => setTimeout(later, POLL_MS));
  }
  go("/log");
}
