import { useMutation, useQueryClient } from "@tanstack/react-query";
import { useEffect, useSyncExternalStore } from "react";
import { useLive, useLiveStore } from "../live/react";
import type { LiveStore } from "../live/store";
import { listenToStop, type StopState, stopState } from "../stop/stop";
import { answered, api } from "../wire/client";
import type { References, State } from "../wire/types";
import { RESTS_ON_PARAMETERS } from "./comparedModels";

/**
 * References are sent in pairs, and a person orders one of them: the other one goes along as it was ordered last, by
 * whatever part of the page, for the state that tells it may still be on its way.
 */

/** The state tells within this time what was accepted [ms]; after it what is in force counts again. */
const TOLD_WITHIN_MS = 1200;
/** References nearer than this are the same, in rad or N·m/rad: of more digits some may be lost on their way. */
const SAME = 1e-5;

/** Sends references, or one of them; rejects where they are refused. All of a page share what was ordered last. */
export function useReferenceOrders() {
  const orders = ordersOf(useLiveStore());
  return useMutation({ mutationFn: (part: Partial<References>) => orders.order(part) });
}

const ORDERS = new WeakMap<LiveStore, Orders>();

function ordersOf(store: LiveStore): Orders {
  const known = ORDERS.get(store) ?? new Orders(store);
  ORDERS.set(store, known);
  return known;
}

/** One after the other: each follows from what came of the one before. */
class Orders {
  private last: Promise<unknown> = Promise.resolve();
  /** What the state may still tell, in order: what it told last, and what was ordered since. */
  private awaited: References[] = [];
  private accepted_ms = Number.NEGATIVE_INFINITY;

  constructor(private readonly store: LiveStore) {
    store.subscribe(() => this.hear());
  }

  order(part: Partial<References>): Promise<void> {
    const mine = this.last.then(() => this.send(part));
    this.last = mine.catch(() => undefined);
    return mine;
  }

  private async send(part: Partial<References>): Promise<void> {
    const told = this.store.snapshot().state?.references;
    const isFresh = performance.now() - this.accepted_ms < TOLD_WITHIN_MS;
    if (!isFresh || this.awaited.length === 0) this.awaited = told && isKnown(told) ? [told] : [];
    const before = this.awaited.at(-1);
    const q_ref = part.q_ref ?? before?.q_ref;
    const S_ref = part.S_ref ?? before?.S_ref;
    if (q_ref === undefined || S_ref === undefined) throw new Error("The other reference is not known yet.");
    const wanted = { q_ref, S_ref };
    this.awaited.push(wanted); // the state may tell it before the answer is there
    try {
      await answered(api.PUT("/api/references", { body: wanted }));
      this.accepted_ms = performance.now();
    } catch (error) {
      this.awaited = this.awaited.filter((one) => one !== wanted);
      throw error;
    }
  }

  /** References that were not ordered here are in force by somebody else, or by the loop: they count from then on. */
  private hear(): void {
    const told = this.store.snapshot().state?.references;
    if (told === undefined || !isKnown(told) || this.awaited.length === 0) return;
    const at = this.awaited.findIndex((one) => isSame(one, told));
    this.awaited = at < 0 ? [] : this.awaited.slice(at);
  }
}

/** Whether both are known: slack tendons have no stiffness, so that none is told as long as no S_ref is in force. */
function isKnown(told: State["references"]): told is State["references"] & References {
  return told.S_ref !== null;
}

function isSame(one: References, other: References): boolean {
  return Math.abs(one.q_ref - other.q_ref) < SAME && Math.abs(one.S_ref - other.S_ref) < SAME;
}

/** Asks again for lists and results when something has happened that changes them. */

const CHANGED_BY_TASKS = ["identifications", "experiments", "runs", "banks", "queue", "checklist"] as const;
/** After so many failed connections the reason may be that the session has ended. */
const FAILURES = 2;

export function useFreshness(): void {
  const queries = useQueryClient();
  const task = useLive((live) => live.state?.task?.run ?? null);
  const recording = useLive((live) => live.state?.recording_run ?? null);
  const starts = useLive((live) => live.state?.link.starts ?? null);
  const bank = useLive((live) => live.state?.tuning.bank?.id ?? null);
  const failing = useLive((live) => live.link.failures >= FAILURES);

  // biome-ignore lint/correctness/useExhaustiveDependencies: the begin and the end of a task or a recording are the reason
  useEffect(() => {
    for (const key of CHANGED_BY_TASKS) void queries.invalidateQueries({ queryKey: [key] });
  }, [queries, task, recording]);

  // parameters come into force with a new loop process, whoever applied them
  useEffect(() => {
    if (starts === null) return;
    for (const key of RESTS_ON_PARAMETERS) void queries.invalidateQueries({ queryKey: [key] });
  }, [queries, starts]);

  // biome-ignore lint/correctness/useExhaustiveDependencies: another bank, whoever activated it, is the reason
  useEffect(() => {
    for (const key of ["banks", "tuning"]) void queries.invalidateQueries({ queryKey: [key] });
  }, [queries, bank]);

  useEffect(() => {
    if (failing) void queries.invalidateQueries({ queryKey: ["session"] });
  }, [queries, failing]);
}

/** What became of the last press of STOP, which works without the application. */

export function useStop(): StopState {
  return useSyncExternalStore(listenToStop, stopState);
}
