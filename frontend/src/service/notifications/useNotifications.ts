/** Tells the person what has happened while the page was not looked at, as they have chosen. */

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

/** What has happened since the page was opened, by what the service tells of its state. Pure. */

interface Trip {
  readonly kind: "trip";
  readonly fault: Fault;
  /** Which start of the loop the fault's tick counts from. */
  readonly starts: number;
}

type PageEvent = Trip | { readonly kind: "over"; readonly run: Task["run"] };

export class EventDetector {
  private before: State | null = null;
  /** The run whose end was told last: in the pause behind it it is over, and stays what the state names. */
  private over: Task["run"] | null = null;

  /** What is new in a state; nothing in the first one, which is of before, and nothing of what a recording plays. */
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

/** Which flight record a trip is in, told by its tick and its time: ticks begin anew with each loop process. Pure. */

/** Clocks that were compared by a header of whole seconds, and the way of that answer, agree within this [ms]. */
const NEAR_MS = 3000;
const PERIOD_MS = 1000 * PERIOD_S;

/** How long ago a trip was [ms], by a state told since; null where the loop was started anew meanwhile. */
function ageOf({ fault, starts }: Trip, state: State | null): number | null {
  if (state === null || state.link.starts !== starts || state.tick < fault.tick) return null;
  return (state.tick - fault.tick) * PERIOD_MS;
}

/**
 * The record of a trip at `at_ms` by the service's clock. Trips that follow each other share the record of the first;
 * of another loop's trip at such a tick, which was at another time, it is not.
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

/** The words of notifications, from what the service says by type. Pure. */

type EventText = Omit<PageNotification, "open">;

/** A run that is over: its kind, its number, how it ended; what it was, and why it ended so. */
export function describeRun({ id, kind, title, end_state, end_reason }: Run, angles: AngleUnit): EventText {
  const more = end_state === "completed" ? [title] : [title, end_reason];
  return {
    tag: `sinew-run-${id}`,
    title: fillText(TEXTS.runOver, { kind: heading(kind), run: id, state: spacedName(end_state) }),
    body: localizeText(more.filter((part) => part !== "").join(" · "), angles),
  };
}

const STOP: Fault["code"] = "stop_pressed";

/** A trip, with its cause and what to do. Somebody who presses STOP makes no trip of it in words. */
export function describeTrip({ fault, starts }: Trip, angles: AngleUnit): EventText {
  return {
    tag: `sinew-trip-${starts}-${fault.tick}`,
    title: fault.code === STOP ? TEXTS.stopped : fillText(TEXTS.tripped, { fault: spacedName(fault.code) }),
    body: localizeText(`${fault.message} ${fault.remedy}`, angles),
  };
}

/** A flight record is there once the seconds after its trip are over. */
const LOOKS = 20;
const LOOK_MS = 500;
/** A run whose last samples are being stored is asked for again after so long [ms], one that could not be had later. */
const AGAIN_MS = 500;
const AFTER_FAILURE_MS = 5000;

export function useNotifications(): void {
  const store = useLiveStore();
  const { preferences } = usePreferences();
  const { notify, sound, angles } = preferences;
  const [, go] = useLocation();
  const ways = { notification: notify, sound };
  const wanted = notify || sound;

  const notifyOfTrip = useEffectEvent((trip: Trip) => {
    if (!wanted) return;
    const received_ms = Date.now() - (ageOf(trip, store.snapshot().state) ?? 0);
    const open = () => {
      const age_ms = ageOf(trip, store.snapshot().state); // of now: a tab that slept has heard of it late
      void openFlight(trip, age_ms === null ? received_ms : Date.now() - age_ms, go);
    };
    void showNotification({ ...describeTrip(trip, angles), open }, ways);
  });
  /** Whether there is nothing more to be told of a run. */
  const notifyOfRun = useEffectEvent(async (id: number): Promise<boolean> => {
    if (!wanted) return true;
    const run = await answered(api.GET("/api/runs/{id}", { params: { path: { id } } }));
    if (run.end_state === "running") return false; // its last samples are being stored
    await showNotification({ ...describeRun(run, angles), open: () => go(`/runs/${id}`) }, ways);
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
      notBefore.set(id, Number.POSITIVE_INFINITY); // while it is asked for
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

/** Whether asking again would be answered the same: it is not there, or not for this person. */
function isFinal(error: unknown): boolean {
  return error instanceof RequestError && error.status >= 400 && error.status < 500 && error.status !== 429;
}

/** Flight records, and by how much the service's clock is ahead of this page's [ms]. */
async function flightsNow(): Promise<{ flights: readonly Flight[]; ahead_ms: number }> {
  const from_ms = Date.now();
  const request = api.GET("/api/flights");
  const { flights } = await answered(request);
  const date = Date.parse((await request).response.headers.get("Date") ?? "");
  // of a header in whole seconds, and at some time of the way there and back
  const ahead_ms = Number.isNaN(date) ? 0 : date + 500 - (from_ms + Date.now()) / 2;
  return { flights, ahead_ms };
}

/** Leads to the record of a trip at `at_ms` by the page's clock; to the log where there is none. */
async function openFlight(trip: Trip, at_ms: number, go: (path: string) => void): Promise<void> {
  for (let look = 0; look < LOOKS; look++) {
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
    await new Promise((later) => setTimeout(later, LOOK_MS));
  }
  go("/log");
}
