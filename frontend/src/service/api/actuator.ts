/** Commands to the actuator: mode, references, pushes, contact, wall. */

import { useMutation } from "@tanstack/react-query";
import { useLiveStore } from "../../live/react";
import type { LiveStore } from "../../live/store";
import { answered, api } from "../../wire/client";
import type { Mode, References, State, TouchOrder, Wall } from "../../wire/types";
import { TEXTS } from "../texts";

export function useSetMode() {
  return useMutation({ mutationFn: (mode: Mode) => answered(api.POST("/api/mode", { body: { mode } })) });
}

export function useReset() {
  return useMutation({ mutationFn: () => answered(api.POST("/api/reset")) });
}

/** A push on the joint of a simulated plant; one of 0 N lets go. */
export function usePush() {
  return useMutation({
    mutationFn: (body: { F_push: number; duration_s: number }) => answered(api.POST("/api/push", { body })),
  });
}

/** What is learned of the outside force, and from what force on the joint gives way. */
export function useConfigureContact() {
  return useMutation({
    mutationFn: (what: Partial<TouchOrder>) =>
      answered(api.PUT("/api/touch", { body: { learn: false, forget: false, ...what } })),
  });
}

/** A wall in the way of a simulated joint; null takes it away. */
export function useSetWall() {
  return useMutation({
    mutationFn: (body: { wall: Wall | null }) => answered(api.PUT("/api/wall", { body })),
  });
}

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
    store.subscribe(() => this.onState());
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
    if (q_ref === undefined || S_ref === undefined) throw new Error(TEXTS.otherReferenceUnknown);
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
  private onState(): void {
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
