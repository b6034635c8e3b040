/**
 * Control of the actuator as this page holds it: every command carries the stamp "key.sequence" of it.
 *
 * The key lives in this page's memory, so that a copy of the tab has none. For a reload it is left in the tab's storage
 * while the page goes, and taken out again by the page that comes, which shows it to the service and gets another one.
 * A page without control takes it with its first command, where nobody else holds it. Commands leave one after the
 * other. A page that shows that it lost control takes it again with its next command. What the service refuses was not
 * done, and is not sent again.
 */

import { addressOf, pathOf } from "./address";
import { readStored, storeText } from "./browserStorage";

const HEADER = "Sinew-Control";
const LEFT_AS = "sinew-control";
/** What moves the actuator or is going to; STOP needs no control. */
const COMMANDS =
  /^\/api\/(mode|reset|references|push|touch|wall|player|tuning|tuning\/(trial.*|undo|redo)|experiments|experiments\/queue\/run|identifications(\/pause)?|parameters(\/undo)?|banks\/(\d+|geometry)\/activate|faults\/injection|bring-up\/[^/]+)$/;
/** A state that comes so soon after control was taken may be from before that. */
const FRESH_MS = 2000;
/** A command waits for the answer to the one before it, but not for ever. */
const TURN_MS = 2000;

interface Held {
  readonly epoch: number;
  readonly key: string;
  readonly sequence: number;
  readonly since_ms: number;
}

let held: Held | null = null;
/** The holder that the newest state of the service names, and when the state came. */
let reported: { readonly epoch: number | null; readonly at_ms: number } | null = null;
let givenUp: number | null = null;
let last: Promise<unknown> = Promise.resolve();
const listeners = new Set<() => void>();

globalThis.addEventListener?.("pagehide", () => {
  if (held !== null) storeText("sessionStorage", LEFT_AS, held.key);
});
// brought back whole by the browser's own cache: nothing was left behind after all
globalThis.addEventListener?.("pageshow", (event) => {
  if (event.persisted) takeLeft();
});
const left = takeLeft();
if (left !== null) void inTurn(() => resume(left)).catch(() => undefined);

/** What others know the control of this page by, null while it holds none. */
export function heldEpoch(): number | null {
  return held?.epoch ?? null;
}

/** The key of the control that this page holds, null for none. */
export function heldKey(): string | null {
  return held?.key ?? null;
}

/** What others knew the control by that this page gave up of its own accord. */
export function givenUpEpoch(): number | null {
  return givenUp;
}

/** Record the holder that a state of the service names, by epoch; null for nobody. */
export function noteHolder(epoch: number | null): void {
  reported = { epoch, at_ms: performance.now() };
}

/** Call `listener` when this page gets or loses control; returns how to stop that. */
export function watchHeld(listener: () => void): () => void {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

/** Take control; over from somebody else only if that is said. Resolves to the service's answer. */
export function takeControl(takeOver: boolean): Promise<Response> {
  return inTurn(() => take({ take_over: takeOver }));
}

/** Take control that was handed over or offered to this person under a number. */
export function takeHanded(number: number): Promise<Response> {
  return inTurn(() => take({ handed: number }));
}

/** Ask for control, offer it, answer: with the stamp of this page where it holds control, which it never takes for it. */
export function postControl(path: "wishes" | `wishes/${number}`, body: object): Promise<Response> {
  return inTurn(() => send(stamped(posted(`/api/control/${path}`, body))));
}

/** Give control up. */
export function giveUpControl(): Promise<Response> {
  return inTurn(async () => {
    const request = new Request(addressOf("/api/control"), { method: "DELETE" });
    givenUp = held?.epoch ?? null;
    const answer = await send(stamped(request));
    keep(null);
    return answer;
  });
}

/** The fetch of all requests of this page. */
export function controlledFetch(request: Request): Promise<Response> {
  if (request.method === "GET" || !COMMANDS.test(pathOf(request.url))) return send(request);
  return inTurn(() => command(request));
}

async function command(request: Request): Promise<Response> {
  if (isLost()) keep(null);
  if (held === null) {
    const taken = await take({ take_over: false });
    if (!taken.ok) return taken;
  }
  const answer = await send(stamped(request));
  if (answer.status === 409 && (await codeOf(answer)) === "control_lost") keep(null);
  return answer;
}

/** Whether a state has shown that this page holds control no more: the service refuses its stamp. */
function isLost(): boolean {
  if (held === null || reported === null) return false;
  return reported.epoch !== held.epoch && reported.at_ms > held.since_ms + FRESH_MS;
}

async function take(
  body: { take_over: boolean } | { resume: string } | { handed: number },
): Promise<Response> {
  const answer = await send(posted("/api/control", body));
  if (answer.ok) {
    const lease = await answer.clone().json();
    keep({ epoch: lease.epoch, key: lease.page, sequence: 0, since_ms: performance.now() });
  }
  return answer;
}

function posted(path: string, body: object): Request {
  return new Request(addressOf(path), {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify(body),
  });
}

function resume(key: string): Promise<Response> {
  return take({ resume: key });
}

/** Begin something once what was begun before it is over. */
function inTurn<Result>(begin: () => Promise<Result>): Promise<Result> {
  const patience = new Promise((resolve) => globalThis.setTimeout(resolve, TURN_MS));
  const mine = Promise.race([last, patience]).then(begin);
  last = mine.catch(() => undefined);
  return mine;
}

function stamped(request: Request): Request {
  if (held === null) return request;
  held = { ...held, sequence: held.sequence + 1 };
  request.headers.set(HEADER, `${held.key}.${held.sequence}`);
  return request;
}

function send(request: Request): Promise<Response> {
  return globalThis.fetch(request);
}

async function codeOf(answer: Response): Promise<unknown> {
  try {
    return (await answer.clone().json()).error.code;
  } catch {
    return null;
  }
}

function keep(next: Held | null): void {
  held = next;
  for (const listener of listeners) listener();
}

function takeLeft(): string | null {
  const key = readStored("sessionStorage", LEFT_AS);
  storeText("sessionStorage", LEFT_AS, null);
  return key;
}
