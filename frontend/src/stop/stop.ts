/**
 * STOP: its button, its keys, its request and the result of a press, in plain DOM.
 *
 * The page loads this file separately from the application and before it, so that STOP works when the application
 * does not: a bundle fails to load, a component throws, a translation replaced texts, or storage is blocked. At run
 * time the file imports only its texts, which the build includes in the same file, and accesses neither storage nor
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

/** Colours of the theme, or similar ones if its style sheet is missing. */
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
let displays = 0;
const listeners = new Set<() => void>();
/** Null without a DOM, in tests of pure functions. */
const elements = globalThis.document === undefined ? null : install();

/** Returns the result of the last press. */
export function stopState(): StopState {
  return state;
}

/** Calls `listener` on each change of the state; returns a function that unsubscribes. */
export function subscribeToStop(listener: () => void): () => void {
  listeners.add(listener);
  return () => void listeners.delete(listener);
}

/** Sends a stop. Each press is a separate request; the page shows the result of the last one. */
export function pressStop(): void {
  presses += 1;
  const number = presses;
  change({ kind: "sending" });
  void sendStop(post).then((result) => {
    if (number === presses) change(result);
  });
}

/** Compares a state of the service with the last press: from then on the service's state counts. */
export function observeState(
  observed: Parameters<typeof nextStopState>[1] & Partial<Pick<State, "player">>,
): void {
  if (elements !== null) elements.button.title = observed.player ? TEXTS.pauses : TEXTS.stops;
  change(nextStopState(state, observed));
}

/** Registers a component that shows sent and confirmed stops; returns a function that removes it. */
export function registerDisplay(): () => void {
  displays += 1;
  draw();
  return () => {
    displays -= 1;
    draw();
  };
}

/** Listens for the keys in a window of this page; returns a function that stops listening. */
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
 * Requests the stop until it is confirmed, at most three times. A refusal and a missing response have the same
 * result: unconfirmed, with the last reason.
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
 * Returns the state of STOP after a later state of the service. The service shows a confirmed stop itself, with its
 * proof until the reset; an unconfirmed one ends when the control loop reports that the motors are off.
 */
export function nextStopState(
  stop: StopState,
  observed: Pick<State, "mode" | "tick" | "stop_proof" | "link">,
): StopState {
  const isResting = observed.link.alive && (observed.mode === "tripped" || observed.mode === "off");
  const isOver =
    stop.kind === "confirmed"
      ? observed.stop_proof?.arrived_tick === stop.proof.arrived_tick || observed.tick >= stop.proof.zero_tick
      : stop.kind === "unconfirmed" && isResting;
  return isOver ? { kind: "idle" } : stop;
}

/** Whether a key event is the combination that stops. */
export function isStopKey(event: Pick<KeyboardEvent, "ctrlKey" | "metaKey" | "shiftKey" | "code">): boolean {
  return (event.ctrlKey || event.metaKey) && event.shiftKey && event.code === "KeyE";
}

/** Text of a state of STOP; for an unconfirmed one the instruction precedes the reason. */
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

/** Inserts fields into a text; this file does not import `fillText`. */
function filled(text: string, fields: Readonly<Record<string, string | number>>): string {
  return text.replace(/\{(\w+)\}/g, (_, name: string) => String(fields[name]));
}
/** Text of the proof that a stop took place. */
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
  // A truncated response, or one of a proxy, contains no proof: the stop is sent again.
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
  if (elements === null) return;
  const { button, notice } = elements;
  button.dataset.sending = String(state.kind === "sending");
  notice.dataset.kind = state.kind;
  // Sets the whole text: this also replaces what a translation inserted.
  notice.textContent = state.kind === "unconfirmed" || displays === 0 ? describeStop(state) : "";
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
    // detail 0: the keyboard or an assistive device pressed the button and sent no pointer event
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
