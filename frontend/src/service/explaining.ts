/**
 * What is being explained, of all the page: one at a time, beside the word that was pointed at, focused or tapped.
 * Pointing waits a moment, so that a pointer on its way opens nothing; focus and tap are answered at once.
 */

import { useSyncExternalStore } from "react";
import type { Entry } from "./glossary";

const POINTED_MS = 350;
/** So long the pointer may take from the word to its explanation. */
const LEFT_MS = 200;

export interface Explained {
  readonly anchor: HTMLElement;
  readonly entries: readonly Entry[];
  readonly by: "pointer" | "focus" | "tap";
}

let shown: Explained | null = null;
let timer: ReturnType<typeof setTimeout> | undefined;
const listeners = new Set<() => void>();

function become(next: Explained | null): void {
  clearTimeout(timer);
  if (next === shown) return;
  shown = next;
  for (const listener of listeners) listener();
}

export function explain(next: Explained): void {
  clearTimeout(timer);
  if (next.by !== "pointer") become(next);
  else if (shown?.anchor !== next.anchor) timer = setTimeout(become, POINTED_MS, next);
}

/** The pointer has left a word; what focus or tap has opened stays. */
export function left(): void {
  clearTimeout(timer);
  if (shown?.by === "pointer") timer = setTimeout(become, LEFT_MS, null);
}

/** The pointer has come to the explanation itself. */
export function stay(): void {
  clearTimeout(timer);
}

export function close(anchor?: HTMLElement): void {
  if (anchor === undefined || shown?.anchor === anchor) become(null);
  else clearTimeout(timer);
}

export function current(): Explained | null {
  return shown;
}

function subscribe(listener: () => void): () => void {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

export function useExplained(): Explained | null {
  return useSyncExternalStore(subscribe, current);
}
