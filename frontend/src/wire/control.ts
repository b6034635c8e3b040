/**
 * Control of the actuator as this page holds it: every command carries the stamp "epoch.sequence" of it.
 *
 * Kept for the tab, so that a reload goes on holding it. A page without control takes it with its first command, where
 * nobody else holds it. What the service refuses was not done, and is not sent again.
 */

const HEADER = "Sinew-Control";
const KEPT_AS = "sinew-control";
/** What moves the actuator or is going to; STOP needs no control. */
const COMMANDS =
  /^\/api\/(mode|reset|references|push|tuning|tuning\/trial.*|experiments|experiments\/queue\/run|identifications|banks\/\d+\/activate|faults\/injection)$/;

interface Held {
  readonly epoch: number;
  readonly sequence: number;
}

let held: Held | null = kept();

/** Epoch of the control that this page believes to hold, null for none. */
export function heldEpoch(): number | null {
  return held?.epoch ?? null;
}

/** Take control; over from somebody else only if that is said. Resolves to the service's answer. */
export async function takeControl(takeOver: boolean): Promise<Response> {
  const answer = await send(
    new Request(new URL("/api/control", globalThis.location.origin), {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ take_over: takeOver }),
    }),
  );
  if (answer.ok) keep({ epoch: (await answer.clone().json()).epoch, sequence: 0 });
  return answer;
}

/** Give control up. */
export async function giveUpControl(): Promise<Response> {
  const request = new Request(new URL("/api/control", globalThis.location.origin), { method: "DELETE" });
  const answer = await send(stamped(request));
  keep(null);
  return answer;
}

/** The fetch of all requests of this page. */
export async function controlledFetch(request: Request): Promise<Response> {
  if (request.method === "GET" || !COMMANDS.test(new URL(request.url).pathname)) return send(request);
  if (held === null) {
    const taken = await takeControl(false);
    if (!taken.ok) return taken;
  }
  const answer = await send(stamped(request));
  if (answer.status === 409 && (await codeOf(answer)) === "control_lost") keep(null);
  return answer;
}

function stamped(request: Request): Request {
  if (held === null) return request;
  keep({ epoch: held.epoch, sequence: held.sequence + 1 });
  request.headers.set(HEADER, `${held.epoch}.${held.sequence}`);
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
  if (next === null) globalThis.sessionStorage?.removeItem(KEPT_AS);
  else globalThis.sessionStorage?.setItem(KEPT_AS, JSON.stringify(next));
}

function kept(): Held | null {
  try {
    const { epoch, sequence } = JSON.parse(globalThis.sessionStorage?.getItem(KEPT_AS) ?? "null");
    return Number.isInteger(epoch) && Number.isInteger(sequence) ? { epoch, sequence } : null;
  } catch {
    return null;
  }
}
