import { afterEach, beforeEach, expect, it, vi } from "vitest";

type Control = typeof import("./control");

const LEASE = { epoch: 7, page: "k7", name: "Ana" };

const fetched = vi.fn<(request: Request) => Promise<Response>>();

function answer(status: number, body: unknown): Response {
  return new Response(JSON.stringify(body), { status });
}

function refusal(code: string): Response {
  return answer(409, { error: { code, message: code } });
}

function command(): Request {
  return new Request("http://localhost/api/mode", { method: "POST", body: '{"mode":"run"}' });
}

/** The module as a page loads it: what was held comes from the tab's storage. */
async function load(): Promise<Control> {
  vi.resetModules();
  return import("./control");
}

function sent(): string[] {
  return fetched.mock.calls.map(
    ([r]) => `${r.method} ${new URL(r.url).pathname} ${r.headers.get("Sinew-Control")}`,
  );
}

beforeEach(() => {
  vi.stubGlobal("fetch", fetched);
  sessionStorage.clear();
});

afterEach(() => {
  fetched.mockReset();
  vi.unstubAllGlobals();
});

it("takes control with its first command where nobody holds it", async () => {
  const control = await load();
  fetched.mockResolvedValueOnce(answer(200, LEASE)).mockResolvedValueOnce(answer(200, {}));
  expect((await control.controlledFetch(command())).ok).toBe(true);
  expect(sent()).toEqual(["POST /api/control null", "POST /api/mode k7.1"]);
  expect(await fetched.mock.calls[0]?.[0].text()).toBe('{"take_over":false}');
  expect(control.heldEpoch()).toBe(7);
});

it("never takes over from somebody by itself, and sends no command then", async () => {
  const control = await load();
  fetched.mockResolvedValueOnce(refusal("control_held"));
  expect((await control.controlledFetch(command())).status).toBe(409);
  expect(sent()).toEqual(["POST /api/control null"]);
  expect(control.heldEpoch()).toBeNull();
});

it.each(["/api/stop", "/api/identifications/prediction", "/api/session", "/api/preferences"])(
  "asks for no control for %s",
  async (path) => {
    const control = await load();
    fetched.mockResolvedValueOnce(answer(200, {}));
    await control.controlledFetch(new Request(`http://localhost${path}`, { method: "POST" }));
    expect(sent()).toEqual([`POST ${path} null`]);
  },
);

it("lets go of control that was taken over, and repeats nothing", async () => {
  const control = await load();
  fetched.mockResolvedValueOnce(answer(200, LEASE)).mockResolvedValueOnce(refusal("control_lost"));
  expect((await control.controlledFetch(command())).status).toBe(409);
  expect(sent()).toEqual(["POST /api/control null", "POST /api/mode k7.1"]);
  expect(control.heldEpoch()).toBeNull();
});

it.each([
  [
    "takes control again that a state has shown as lost",
    null,
    2500,
    ["POST /api/control null", "POST /api/mode k8.1"],
  ],
  ["keeps control of which a state may not know yet", null, 1500, ["POST /api/mode k7.1"]],
  ["keeps control that a state confirms", 7, 2500, ["POST /api/mode k7.1"]],
])("%s", async (_, epoch, after_ms, calls) => {
  const now = vi.spyOn(performance, "now").mockReturnValue(1000);
  const control = await load();
  fetched.mockResolvedValueOnce(answer(200, LEASE));
  await control.takeControl(false);
  fetched.mockReset();
  now.mockReturnValue(1000 + after_ms);
  control.noteHolder(epoch);
  if (calls.length === 2) fetched.mockResolvedValueOnce(answer(200, { epoch: 8, page: "k8", name: "Ana" }));
  fetched.mockResolvedValueOnce(answer(200, {}));
  expect((await control.controlledFetch(command())).ok).toBe(true);
  expect(sent()).toEqual(calls);
  now.mockRestore();
});

it("sends its commands one after the other, and takes control once", async () => {
  const control = await load();
  const answers: ((answer: Response) => void)[] = [];
  fetched.mockImplementation(() => new Promise((resolve) => answers.push(resolve)));
  const both = [control.controlledFetch(command()), control.controlledFetch(command())];
  for (const [index, body] of [LEASE, {}, {}].entries()) {
    await vi.waitFor(() => expect(answers).toHaveLength(index + 1));
    answers[index]?.(answer(200, body));
  }
  await Promise.all(both);
  expect(sent()).toEqual(["POST /api/control null", "POST /api/mode k7.1", "POST /api/mode k7.2"]);
});

it("leaves nothing in the tab while it is open, so that a copy of the tab holds no control", async () => {
  const control = await load();
  fetched.mockResolvedValueOnce(answer(200, LEASE));
  await control.takeControl(true);
  expect(control.heldKey()).toBe("k7");
  expect(sessionStorage).toHaveLength(0);
  const copy = await load();
  expect(copy.heldKey()).toBeNull();
  expect(fetched).toHaveBeenCalledTimes(1);
});

it("goes on holding control after a reload, by a key of its own", async () => {
  const control = await load();
  fetched.mockResolvedValueOnce(answer(200, LEASE));
  await control.takeControl(true);
  window.dispatchEvent(new Event("pagehide"));
  fetched.mockResolvedValueOnce(answer(200, { epoch: 8, page: "k8", name: "Ana" }));
  fetched.mockResolvedValueOnce(answer(200, {}));
  const again = await load();
  expect(sessionStorage).toHaveLength(0);
  await again.controlledFetch(command());
  expect(sent()).toEqual(["POST /api/control null", "POST /api/control null", "POST /api/mode k8.1"]);
  expect(await fetched.mock.calls[1]?.[0].text()).toBe('{"resume":"k7"}');
  expect(again.heldEpoch()).toBe(8);
});

it("is an observer after a reload that took too long", async () => {
  sessionStorage.setItem("sinew-control", "k7");
  fetched.mockResolvedValueOnce(refusal("control_lost"));
  const control = await load();
  await vi.waitFor(() => expect(fetched).toHaveBeenCalledTimes(1));
  expect(control.heldKey()).toBeNull();
});
