/** A refusal appears once, in full, at the field that it names; the field is marked and focused. */
import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import type { ReactElement } from "react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client captures fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  vi.stubGlobal(
    "ResizeObserver",
    class {
      observe() {}
      unobserve() {}
      disconnect() {}
    },
  );
  return replacement;
});

import { NameQuestion } from "../components/NameQuestion";
import { TEXTS as SHARED } from "../components/texts";
import { LiveProvider } from "../live/react";
import { LiveStore } from "../live/store";
import { fillText } from "../samples/texts";
import { useDryRun } from "../service/api/experiments";
import type { Run, Tuning } from "../wire/types";
import { BankImport } from "./banks/BanksPage";
import { ExperimentForm } from "./experiments/ExperimentForm";
import { TEXTS as EXPERIMENT_TEXTS } from "./experiments/texts";
import { IdentificationForm } from "./identify/IdentificationForm";
import { BankBuilder } from "./identify/IdentificationList";
import { SpringTableForm } from "./identify/SpringResult";
import { TEXTS as IDENTIFY } from "./identify/texts";
import { DisturbanceCard } from "./operate/DisturbanceCard";
import { TuningChanges } from "./operate/TuningCard";
import { TEXTS as OPERATE } from "./operate/texts";
import { WallCard } from "./operate/WallCard";
import { KINDS, STATE, TRACKING, TUNING } from "./refusals.fixture";
import { NoteCard } from "./runs/RunDetail";

const STAGED = { staging: true, values: { lam_q: 0.7 }, turn() {}, stage() {}, discard() {} };
const SENTENCE = "what was given: 120° is outside −80 to 80°; choose a value between the two";

/** Path of the refused request and of its field; other requests get answers of an empty service. */
let refusal: { path: string; place?: (string | number)[] | undefined };

function answer({ url, method }: Request): Response {
  const path = new URL(url).pathname;
  if (path === refusal.path && method !== "GET") {
    const error = { code: "bad_value", message: SENTENCE, ...(refusal.place ? { path: refusal.place } : {}) };
    return Response.json({ error }, { status: 422 });
  }
  if (path === "/api/session") return Response.json({ name: "A. Operator", role: "operator" });
  if (path === "/api/control") return Response.json({ epoch: 1, page: "k".repeat(16), name: "A. Operator" });
  if (path === "/api/banks") return Response.json({ banks: [] });
  if (path === "/api/tuning/saved") return Response.json({ ...TUNING, who: null, at: null });
  if (path === "/api/identification-kinds") return Response.json({ kinds: KINDS });
  if (path === "/api/preferences") return Response.json({ angles: "deg" });
  return Response.json({ error: { code: "not_found", message: "nothing here" } }, { status: 404 });
}

function open(page: ReactElement): void {
  const store = new LiveStore(0);
  store.setState(STATE);
  const client = new QueryClient({ defaultOptions: { queries: { retry: false } } });
  render(
    <MantineProvider>
      <QueryClientProvider client={client}>
        <LiveProvider store={store}>{page}</LiveProvider>
      </QueryClientProvider>
    </MantineProvider>,
  );
}

beforeEach(() => {
  // an auto-sized box listens for font events
  Object.defineProperty(document, "fonts", { value: new EventTarget(), configurable: true });
  fetched.mockReset().mockImplementation(async (request) => answer(request));
});
afterEach(() => {
  cleanup();
  localStorage.clear();
});

const press = (name: string) => async () => {
  const button = await screen.findByRole("button", { name });
  await waitFor(() => expect(button.getAttribute("aria-disabled") ?? "false").toBe("false"));
  fireEvent.click(button);
};
const choose = (text: string) => async () => {
  const file = new File([text], "file.csv");
  file.text = async () => text;
  const input = document.querySelector("input[type=file]") as HTMLInputElement;
  fireEvent.change(input, { target: { files: [file] } });
};
const type = (label: string, value: string) => async () => {
  fireEvent.change(await screen.findByLabelText(label), { target: { value } });
};
const nothing = () => undefined;
const Experiment = () => <ExperimentForm kind={TRACKING} onStarted={nothing} dryRun={useDryRun()} />;
const experiment = <Experiment />;
const identification = <IdentificationForm onStarted={nothing} onTable={nothing} onForecast={nothing} />;
const note = <NoteCard run={{ id: 3, note: "", kind: "session" } as Run} />;

type Case = [
  string,
  ReactElement,
  (() => Promise<void>)[],
  string,
  (string | number)[] | undefined,
  () => HTMLElement,
];

const field = (name: string | RegExp) => () => screen.getByLabelText(name);

it.each<Case>([
  [
    "duration of a trial",
    <TuningChanges key="" tuning={TUNING as unknown as Tuning} staged={STAGED} locked={null} />,
    [press(OPERATE.tryFor)],
    "/api/tuning/trial",
    ["duration_s"],
    field(OPERATE.trialDuration),
  ],
  [
    "push",
    <DisturbanceCard key="" />,
    [press(OPERATE.applyPush)],
    "/api/push",
    ["F_push"],
    field(OPERATE.pushForce),
  ],
  [
    "angle of an obstacle",
    <WallCard key="" />,
    [press(OPERATE.addWall)],
    "/api/wall",
    ["wall", "q_wall"],
    field(fillText(OPERATE.wallAngle, { unit: "°" })),
  ],
  [
    "stiffness of an obstacle",
    <WallCard key="" />,
    [press(OPERATE.addWall)],
    "/api/wall",
    ["wall", "k_wall"],
    field(OPERATE.wallStiffness),
  ],
  [
    "damping of an obstacle",
    <WallCard key="" />,
    [press(OPERATE.addWall)],
    "/api/wall",
    ["wall", "c_wall"],
    field(OPERATE.wallDamping),
  ],
  [
    "duration of a push",
    <DisturbanceCard key="" />,
    [press(OPERATE.applyPush)],
    "/api/push",
    ["duration_s"],
    field(OPERATE.pushDuration),
  ],
  [
    "file of a bank",
    <BankImport key="" />,
    [choose("{}")],
    "/api/banks/file",
    ["entries", 0, "K_q"],
    () => screen.getByRole("button", { name: /Import bank/ }),
  ],
  [
    "file of a bank without a path",
    <BankImport key="" />,
    [choose("{}")],
    "/api/banks/file",
    undefined,
    () => screen.getByRole("button", { name: /Import bank/ }),
  ],
  ["note", note, [type("Note", "long"), press("Save note")], "/api/runs/3", ["note"], field("Note")],
  [
    "table of a spring",
    <SpringTableForm key="" onTable={nothing} />,
    [choose("x,F")],
    "/api/spring-tables",
    undefined,
    () => screen.getByRole("button", { name: (name) => name.includes(IDENTIFY.tableFile) }),
  ],
  [
    "decimal mark of a table",
    <SpringTableForm key="" onTable={nothing} />,
    [choose("x;F")],
    "/api/spring-tables",
    ["decimal"],
    field(IDENTIFY.decimalMark),
  ],
  [
    "heading of a table",
    <SpringTableForm key="" onTable={nothing} />,
    [type(IDENTIFY.headingLine, "3"), choose("x;F")],
    "/api/spring-tables",
    ["header"],
    field(IDENTIFY.headingLine),
  ],
  [
    "one of several tensions",
    identification,
    [type(IDENTIFY.tensionList, "10, 90"), press(IDENTIFY.start)],
    "/api/identifications",
    ["tensions_N", 1],
    field(IDENTIFY.tensionList),
  ],
  [
    "choice of an identification",
    identification,
    [press(IDENTIFY.start)],
    "/api/identifications",
    ["actuator", "estimator"],
    field("Estimator"),
  ],
  ["choice", experiment, [press("Start tracking")], "/api/experiments", ["law"], field("Law in use")],
  [
    "switch",
    experiment,
    [press("Start tracking")],
    "/api/experiments",
    ["interpolate"],
    () => screen.getByRole("switch"),
  ],
  [
    "bank to use",
    experiment,
    [press("Start tracking")],
    "/api/experiments",
    ["bank"],
    field(EXPERIMENT_TEXTS.gainSource),
  ],
  [
    "name of a person",
    <NameQuestion key="" wanted onDone={nothing} />,
    [type(SHARED.nameWanted, "Ana"), press(SHARED.saveName)],
    "/api/session/name",
    undefined,
    field(SHARED.nameWanted),
  ],
  [
    "name of a bank",
    <BankBuilder key="" chosen={new Set([1])} onBuilt={nothing} />,
    [type(IDENTIFY.bankName, "lab"), press(IDENTIFY.buildBank)],
    "/api/banks",
    ["name"],
    field(IDENTIFY.bankName),
  ],
])("shows the refusal of the %s at its field", async (_kind, page, steps, path, place, meant) => {
  refusal = { path, place };
  open(page);
  for (const step of steps) await step();
  const message = await screen.findByText(SENTENCE);
  expect(screen.getAllByText(SENTENCE)).toEqual([message]);
  const box = meant();
  const described = box.getAttribute("aria-describedby")?.split(" ") ?? [];
  expect(described.some((id) => document.getElementById(id)?.contains(message))).toBe(true);
  await waitFor(() => expect(document.activeElement).toBe(box));
  const marked = [...document.querySelectorAll("[aria-invalid=true], [data-refused=true][type=button]")];
  expect(marked).toEqual([box]);
});

it.each([
  ["10; a", "“a” is not a number"],
  ["1 2 3 4 5 6 7 8 9", "at most 8"],
])("shows at the field that %j is not a list of tensions", async (text, why) => {
  refusal = { path: "" };
  open(identification);
  await type(IDENTIFY.tensionList, text)();
  const box = screen.getByLabelText(IDENTIFY.tensionList);
  expect(box.getAttribute("aria-invalid")).toBe("true");
  const described = box.getAttribute("aria-describedby")?.split(" ") ?? [];
  expect(described.map((id) => document.getElementById(id)?.textContent).join()).toContain(why);
});

it("names the field of an identification that is not a number", async () => {
  refusal = { path: "" };
  open(identification);
  await type(IDENTIFY.tension, "much")();
  const message = screen.getByRole("status", { name: "Refusal" }).textContent;
  expect(message).toBe("Tension: “much” is not a number.");
});

it("does not move the focus from the edited field when a forecast is refused", async () => {
  refusal = { path: "/api/identifications/prediction", place: ["actuator", "estimator"] };
  open(identification);
  const box = await screen.findByLabelText(IDENTIFY.tension);
  act(() => box.focus());
  await type(IDENTIFY.tension, "44")();
  await waitFor(() => expect(field("Estimator")().getAttribute("aria-invalid")).toBe("true"));
  expect(document.activeElement).toBe(box);
  expect(screen.getAllByText(SENTENCE)).toHaveLength(1);
});

it("shows at the duration of a trial that it is not a number", async () => {
  refusal = { path: "" };
  open(<TuningChanges tuning={TUNING as unknown as Tuning} staged={STAGED} locked={null} />);
  await type(OPERATE.trialDuration, "ten")();
  const box = screen.getByLabelText(OPERATE.trialDuration);
  expect(box.getAttribute("aria-invalid")).toBe("true");
  const described = box.getAttribute("aria-describedby")?.split(" ") ?? [];
  expect(described.map((id) => document.getElementById(id)?.textContent).join()).toContain(
    "“ten” is not a number",
  );
  await act(async () => fireEvent.click(screen.getByRole("button", { name: OPERATE.tryFor })));
  expect(fetched.mock.calls.filter(([{ url }]) => url.endsWith("/trial"))).toEqual([]);
});
