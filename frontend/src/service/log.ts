import { infiniteQueryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import { heading, inWordsOf } from "../samples/format";
import { type Angles, inWords } from "../samples/quantity";
import { answered, api } from "../wire/client";
import { PERIOD_S } from "../wire/sample.gen";
import type { Fault, Flight, LogEntry, Run, State, Task } from "../wire/types";
import type { Allowed, LocalizedText } from "./notifications";

/** The log: everything that happened, and what people say of it. */

export type LogKind = LogEntry["kind"];

/** What of it is asked for: all kinds where there are none; times as the service has them, or "". */
export interface LogAsked {
  readonly kinds: readonly LogKind[];
  readonly words: string;
  readonly since: string;
  readonly before: string;
  /** The unit in which the words were read. */
  readonly angles: Angles;
}

const PAGE = 100;
const LOOK_MS = 2000;
/** Words are looked for in all that there is, which takes the service tenths of a second in a long log. */
const SEARCH_MS = 8000;

/** Newest first, a page after the other; the newest are looked for again as long as nothing older was asked for. */
export function logQuery(asked: LogAsked) {
  const look_ms = asked.words === "" ? LOOK_MS : SEARCH_MS;
  return infiniteQueryOptions({
    queryKey: ["log", asked],
    queryFn: ({ pageParam }) => {
      const before = pageParam || asked.before;
      const query = {
        kind: [...asked.kinds],
        words: asked.words,
        angles: asked.angles,
        limit: PAGE,
        ...(asked.since === "" ? {} : { since: asked.since }),
        ...(before === "" ? {} : { before }),
      };
      return answered(api.GET("/api/log", { params: { query } }));
    },
    initialPageParam: "",
    getNextPageParam: (page) => page.more_before,
    placeholderData: (shown) => shown,
    refetchInterval: ({ state }) => ((state.data?.pages.length ?? 1) === 1 ? look_ms : false),
    retry: false,
  });
}

export interface Remark {
  readonly note: string;
  readonly tags: string[];
}

export function useRemark(event: number) {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: Remark) =>
      answered(api.PUT("/api/log/{id}/remark", { params: { path: { id: event } }, body })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["log"] }),
  });
}

/** What has happened since the page was opened, by what the service tells of its state. Pure. */

export interface Trip {
  readonly kind: "trip";
  readonly fault: Fault;
  /** Which start of the loop the fault's tick counts from. */
  readonly starts: number;
}

export type Happening = Trip | { readonly kind: "over"; readonly run: Task["run"] };

export class Happenings {
  private before: State | null = null;
  /** The run whose end was told last: in the pause behind it it is over, and stays what the state names. */
  private over: Task["run"] | null = null;

  /** What is new in a state; nothing in the first one, which is of before, and nothing of what a recording plays. */
  heard(state: State): Happening[] {
    const { before } = this;
    this.before = state;
    if (before === null) this.over = isPaused(state.task) ? state.task.run : null;
    if (before === null || state.plant.kind === "replay") return [];
    const found: Happening[] = [];
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
export function ageOf({ fault, starts }: Trip, state: State | null): number | null {
  if (state === null || state.link.starts !== starts || state.tick < fault.tick) return null;
  return (state.tick - fault.tick) * PERIOD_MS;
}

/**
 * The record of a trip at `at_ms` by the service's clock. Trips that follow each other share the record of the first;
 * of another loop's trip at such a tick, which was at another time, it is not.
 */
export function recordOf(flights: readonly Flight[], { fault }: Trip, at_ms: number): Flight | undefined {
  const apart = flights.flatMap((flight) => {
    if (flight.kind !== "trip") return [];
    const after_ms = (fault.tick - flight.tick) * PERIOD_MS;
    if (after_ms < 0 || after_ms > 1000 * flight.after_s) return [];
    return [{ flight, ms: Math.abs(Date.parse(flight.at) + after_ms - at_ms) }];
  });
  return apart.filter(({ ms }) => ms <= NEAR_MS).sort((a, b) => a.ms - b.ms)[0]?.flight;
}

/** The words of notifications, from what the service says by type. Pure. */

type Words = Omit<LocalizedText, "open">;

/** A run that is over: its kind, its number, how it ended; what it was, and why it ended so. */
export function wordsOfRun({ id, kind, title, end_state, end_reason }: Run, angles: Angles): Words {
  const more = end_state === "completed" ? [title] : [title, end_reason];
  return {
    tag: `sinew-run-${id}`,
    title: `${heading(kind)}, run ${id}: ${inWordsOf(end_state)}`,
    body: inWords(more.filter((part) => part !== "").join(" · "), angles),
  };
}

const STOP: Fault["code"] = "stop_pressed";

/** A trip, with its cause and what to do. Somebody who presses STOP makes no trip of it in words. */
export function wordsOfTrip({ fault, starts }: Trip, angles: Angles): Words {
  return {
    tag: `sinew-trip-${starts}-${fault.tick}`,
    title: fault.code === STOP ? "Stopped" : `Tripped: ${inWordsOf(fault.code)}`,
    body: inWords(`${fault.message} ${fault.remedy}`, angles),
  };
}

const WHY_NOT: Readonly<Record<Allowed, string>> = {
  granted: "",
  default: "This browser has not allowed notifications of this page yet: switch on here, and allow it.",
  denied:
    "This browser refuses notifications of this page. Allow them in its settings for this site, beside the address, then switch on here again.",
  insecure:
    "Browsers show notifications only of pages over HTTPS, or on the machine of the service itself: open the page there, or have it served over HTTPS.",
  missing: "This browser has no notifications: use another one, or the sound.",
};

/** What keeps notifications from being shown here, and what to do; "" where nothing does. */
export function whyNotTold(allowed: Allowed): string {
  return WHY_NOT[allowed];
}
