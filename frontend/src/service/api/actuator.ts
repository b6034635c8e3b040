/** Commands to the actuator: mode, references, pushes, contact, obstacle. */

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

/** Sends a push on the joint of a simulated plant; a push of 0 N releases the joint. */
export function usePush() {
  return useMutation({
    mutationFn: (body: { F_push: number; duration_s: number }) => answered(api.POST("/api/push", { body })),
  });
}

/** Sets the bias of the external force, and the threshold of the contact reaction. */
export function useConfigureContact() {
  return useMutation({
    mutationFn: (changes: Partial<TouchOrder>) =>
      answered(api.PUT("/api/touch", { body: { learn: false, forget: false, ...changes } })),
  });
}

/** Sets the obstacle of a simulated joint; null removes it. */
export function useSetWall() {
  return useMutation({
    mutationFn: (body: { wall: Wall | null }) => answered(api.PUT("/api/wall", { body })),
  });
}

/**
 * The service takes references in pairs, and a person changes one of them. The page sends the other one as any of its
 * parts sent it last, because the state that reports it may not have arrived yet.
 */

/** Time within which the state reports accepted references [ms]; after it, the reported ones apply again. */
const REPORTED_WITHIN_MS = 1200;
/** References closer than this are equal, in rad or N·m/rad: the transfer may round further digits. */
const SAME = 1e-5;

/** Sends both references or one; rejects on a refusal. All components of a page share the last references sent. */
export function useReferenceOrders() {
  const sender = senderFor(useLiveStore());
  return useMutation({ mutationFn: (part: Partial<References>) => sender.send(part) });
}

const SENDERS = new WeakMap<LiveStore, ReferenceSender>();

function senderFor(store: LiveStore): ReferenceSender {
  const known = SENDERS.get(store) ?? new ReferenceSender(store);
  SENDERS.set(store, known);
  return known;
}

/** Sends references one after the other: each request depends on the result of the previous one. */
class ReferenceSender {
  private last: Promise<unknown> = Promise.resolve();
  /** References that the state may report next, in order: those it reported last, then those sent since. */
  private awaited: References[] = [];
  private accepted_ms = Number.NEGATIVE_INFINITY;

  constructor(private readonly store: LiveStore) {
    store.subscribe(() => this.onState());
  }

  send(part: Partial<References>): Promise<void> {
    const mine = this.last.then(() => this.request(part));
    this.last = mine.catch(() => undefined);
    return mine;
  }

  private async request(part: Partial<References>): Promise<void> {
    const reported = this.store.snapshot().state?.references;
    const isFresh = performance.now() - this.accepted_ms < REPORTED_WITHIN_MS;
    if (!isFresh || this.awaited.length === 0) this.awaited = reported && isKnown(reported) ? [reported] : [];
    const before = this.awaited.at(-1);
    const q_ref = part.q_ref ?? before?.q_ref;
    const S_ref = part.S_ref ?? before?.S_ref;
    if (q_ref === undefined || S_ref === undefined) throw new Error(TEXTS.otherReferenceUnknown);
    const wanted = { q_ref, S_ref };
    this.awaited.push(wanted); // the state may report it before the answer arrives
    try {
      await answered(api.PUT("/api/references", { body: wanted }));
      this.accepted_ms = performance.now();
    } catch (error) {
      this.awaited = this.awaited.filter((one) => one !== wanted);
      throw error;
    }
  }

  /** Drops the references before the reported ones; references from another client or the loop drop all of them. */
  private onState(): void {
    const reported = this.store.snapshot().state?.references;
    if (reported === undefined || !isKnown(reported) || this.awaited.length === 0) return;
    const at = this.awaited.findIndex((one) => isSame(one, reported));
    this.awaited = at < 0 ? [] : this.awaited.slice(at);
  }
}

/** Whether both are known: slack tendons have no stiffness, so the state reports none until an S_ref is active. */
function isKnown(reported: State["references"]): reported is State["references"] & References {
  return reported.S_ref !== null;
}

function isSame(one: References, other: References): boolean {
  return Math.abs(one.q_ref - other.q_ref) < SAME && Math.abs(one.S_ref - other.S_ref) < SAME;
}
