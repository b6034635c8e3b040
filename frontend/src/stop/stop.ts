/**
 * STOP by itself: its button, its keys, its request and the result of a press, in plain DOM.
 *
 * The page loads this file apart from the application and before it, so that STOP works where the application does not:
 * a bundle that fails to load, a component that throws, text that a translation replaced, storage that is blocked. It
 * imports nothing at run time but its texts, which the build puts into the same file, and touches neither storage nor
 * cookies.
 */

import type { State, StopProof } from "../wire/types";
import { TEXTS } from "./texts";

export type StopState =
  | { readonly kind: "idle" }
  | { readonly kind: "sending" }
  | { readonly kind: "confirmed"; readonly proof: StopProof }
  | { readonly kind: "unconfirmed"; readonly reason: string };

const ATTEMPTS = 3;
const ANSWER_WITHIN_MS = 1500;

/** Colours of the theme, or their like where its style sheet is missing. */
const STYLE = `
.sinew-stop {
  position: fixed; top: 7px; right: 12px; z-index: 400; box-sizing: border-box; display: inline-flex;
  align-items: center; justify-content: center; gap: 10px; width: 128px; height: 42px; padding: 0; border: 0;
  border-radius: 6px; background: var(--fault, #b3261e); color: #ffffff; font: 700 16px/1 system-ui, sans-serif;
  letter-spacing: 0.06em; cursor: pointer; touch-action: manipulation; user-select: none;
}
.sinew-stop::before { width: 13px; height: 13px; border-radius: 2px; background: currentColor; content: ""; }
.sinew-stop:hover { filter: brightness(1.08); }
.sinew-stop:active, .sinew-stop[data-sending="true"] { filter: brightness(0.8); }
.sinew-stop:focus-visible { outline: 3px solid var(--text, #808080); outline-offset: 2px; }
.sinew-stop-notice {
  position: fixed; top: 56px; right: 8px; z-index: 400; box-sizing: border-box; width: max-content;
  max-width: min(560px, calc(100vw - 16px)); max-height: calc(100vh - 64px); padding: 10px 14px; overflow: auto;
  border-radius: 6px; background: var(--fault, #b3261e); color: #ffffff; font: 700 16px/1.4 system-ui, sans-serif;
  overflow-wrap: anywhere; box-shadow: 0 2px 12px rgb(0 0 0 / 40%);
}
.sinew-stop-notice:empty { display: none; }
.sinew-stop-notice[data-kind="sending"], .sinew-stop-notice[data-kind="confirmed"] {
  background: var(--panel, #ffffff); color: var(--text, #1a1a1a);
}
@media (max-width: 700px) { .sinew-stop { right: 8px; width: 108px; } }
`;

let state: StopState = { kind: "idle" };
let presses = 0;
let pages = 0;
const listeners = new Set<() => void>();
/** Null where there is no page: in tests that only compute. */
const shown = globalThis.document === undefined ? null : install();

/** What became of the last press. */
export function stopState(): StopState {
  return state;
}

/** Call `listener` with each change of the state; returns how to end that. */
export function listenToStop(listener: () => void): () => void {
  listeners.add(listener);
  return () => void listeners.delete(listener);
}

/** Stop. Each press is a request of its own; the page shows the result of the last one. */
export function pressStop(): void {
  presses += 1;
  const number = presses;
  change({ kind: "sending" });
  void sendStop(post).then((result) => {
    if (number === presses) change(result);
  });
}

/** Take in a state of the service: from here on the service's word counts. */
export function observeState(told: Parameters<typeof settled>[1] & Partial<Pick<State, "player">>): void {
  if (shown !== null) shown.button.title = told.player ? TEXTS.pauses : TEXTS.stops;
  change(settled(state, told));
}

/** A part of the application shows that STOP was sent and confirmed, until the call that this returns. */
export function showElsewhere(): () => void {
  pages += 1;
  draw();
  return () => {
    pages -= 1;
    draw();
  };
}

/** Listen for the keys in a window of this page; returns how to end that. */
export function watchKeys(target: Window): () => void {
  const onKey = (event: KeyboardEvent) => {
    if (!isStopKey(event)) return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) pressStop();
  };
  target.addEventListener("keydown", onKey, { capture: true });
  return () => target.removeEventListener("keydown", onKey, { capture: true });
}

/**
 * Ask for the stop until it is confirmed, at most three times. A refusal and a silent network end alike: not confirmed,
 * with the last reason.
 */
export async function sendStop(send: () => Promise<StopProof>): Promise<StopState> {
  let reason = "";
  for (let attempt = 0; attempt < ATTEMPTS; attempt++) {
    try {
      return { kind: "confirmed", proof: await send() };
    } catch (error) {
      reason = error instanceof Error ? error.message : String(error);
    }
  }
  return { kind: "unconfirmed", reason };
}

/**
 * What is left to say of a press once `told` came in after it. A stop that took place belongs to the service, which has
 * its proof until the reset; one that was not confirmed is over when the loop itself says that the motors rest.
 */
export function settled(
  stop: StopState,
  told: Pick<State, "mode" | "tick" | "stop_proof" | "link">,
): StopState {
  const isResting = told.link.alive && (told.mode === "tripped" || told.mode === "off");
  const isOver =
    stop.kind === "confirmed"
      ? told.stop_proof?.arrived_tick === stop.proof.arrived_tick || told.tick >= stop.proof.zero_tick
      : stop.kind === "unconfirmed" && isResting;
  return isOver ? { kind: "idle" } : stop;
}

/** True for the one key combination that stops. */
export function isStopKey(event: Pick<KeyboardEvent, "ctrlKey" | "metaKey" | "shiftKey" | "code">): boolean {
  return (event.ctrlKey || event.metaKey) && event.shiftKey && event.code === "KeyE";
}

/** The sentence of a state of STOP; the instruction of one that was not confirmed comes before its reason. */
export function describeStop(stop: StopState): string {
  switch (stop.kind) {
    case "idle":
      return "";
    case "sending":
      return TEXTS.sending;
    case "confirmed":
      return describeProof(stop.proof);
    case "unconfirmed":
      return filled(TEXTS.unconfirmed, { reason: stop.reason });
  }
}

/** A text with its fields filled in; `fillText` is outside of this file. */
function filled(text: string, fields: Readonly<Record<string, string | number>>): string {
  return text.replace(/\{(\w+)\}/g, (_, name: string) => String(fields[name]));
}
/** The sentence of the proof that a stop took place. */
export function describeProof(proof: StopProof): string {
  if (proof.paused_recording) return filled(TEXTS.paused, { tick: proof.zero_tick });
  const steps = proof.zero_tick - proof.arrived_tick;
  return filled(TEXTS.proof, {
    steps: steps === 1 ? TEXTS.step : filled(TEXTS.steps, { count: steps }),
    time: proof.milliseconds.toFixed(2),
    tick: proof.zero_tick,
  });
}

async function post(): Promise<StopProof> {
  const address = new URL("./api/stop", location.href.replace(/[?#].*$/, ""));
  let response: Response;
  try {
    const signal = AbortSignal.timeout(ANSWER_WITHIN_MS);
    response = await fetch(new Request(address, { method: "POST", credentials: "same-origin", signal }));
  } catch {
    throw new Error(TEXTS.unreachable);
  }
  const answer = await response.json().catch(() => null);
  if (!response.ok)
    throw new Error(answer?.error?.message ?? filled(TEXTS.refused, { status: response.status }));
  // cut off on its way, or of a proxy: no proof, so the stop is asked for again
  if (typeof answer?.zero_tick !== "number") throw new Error(TEXTS.noProof);
  return answer;
}

function change(next: StopState): void {
  if (next === state) return;
  state = next;
  draw();
  for (const listener of listeners) listener();
}

function draw(): void {
  if (shown === null) return;
  const { button, notice } = shown;
  button.dataset.sending = String(state.kind === "sending");
  notice.dataset.kind = state.kind;
  // with its text alone: whatever took the place of its text before, it is gone
  notice.textContent = state.kind === "unconfirmed" || pages === 0 ? describeStop(state) : "";
}

function install(): { button: HTMLButtonElement; notice: HTMLElement } {
  const button = document.createElement("button");
  const notice = document.createElement("div");
  const style = document.createElement("style");
  style.textContent = STYLE;
  button.type = "button";
  button.className = "sinew-stop";
  button.textContent = TEXTS.stop;
  button.title = TEXTS.stops;
  button.setAttribute("aria-label", TEXTS.stop);
  button.setAttribute("aria-keyshortcuts", "Control+Shift+E Meta+Shift+E");
  button.addEventListener("pointerdown", (event) => {
    if (event.button === 0) pressStop();
  });
  button.addEventListener("click", (event) => {
    // detail 0: pressed by the keyboard or an assistive device, which sends no pointer event
    if (event.detail === 0) pressStop();
  });
  notice.className = "sinew-stop-notice";
  notice.setAttribute("role", "alert");
  notice.setAttribute("aria-label", TEXTS.stop);
  for (const element of [button, notice]) element.setAttribute("translate", "no");
  document.head.append(style);
  document.body.append(button, notice);
  watchKeys(window);
  return { button, notice };
}
