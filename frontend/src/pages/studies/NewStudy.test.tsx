// @vitest-environment jsdom
/** The form and the text of a study have the same content, whichever is edited; both are a draft. */
import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, fireEvent, render, screen, waitFor, within } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client captures fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});

import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { fillText } from "../../samples/texts";
import { NewStudy } from "./NewStudy";
import { TEXTS } from "./texts";

const TEXT = "format: 1\nname: a\ntitle: A\naxes: [{over: lam_q, first: 0.4, last: 1.0, count: 5}]\n";
const DOCUMENT = {
  format: 1,
  name: "a",
  title: "A",
  axes: [{ over: "lam_q", first: 0.4, last: 1, count: 5 }],
};
const setting = (name: string, symbol: string, unit: string, value: unknown) => ({
  ...{
    name,
    symbol,
    unit,
    meaning: `what ${name} is`,
    default: value,
    minimum: null,
    maximum: null,
    choices: null,
  },
});
const KINDS = [
  {
    name: "tracking",
    title: "Tracking",
    run_kind: "tracking",
    settings: [
      setting("q_hold", "q_hold", "rad", 0),
      setting("lam_q", "λ_q", "s", 0.5),
      setting("lam_S", "λ_S", "s", 0.42),
      setting("motion", "motion", "1", "lambda"),
    ],
  },
];

async function answer(request: Request): Promise<Response> {
  const path = new URL(request.url).pathname;
  if (path === "/api/session") return Response.json({ name: "Mara", role: "operator" });
  if (path === "/api/experiments") return Response.json({ experiments: KINDS });
  if (path === "/api/studies/numbers")
    return Response.json({ numbers: [{ name: "motor.c0", value: 0.05, unit: "V" }] });
  if (path === "/api/studies/check") {
    const { text } = await request.json();
    return Response.json(
      text === TEXT
        ? { document: DOCUMENT, points: 5, problem: "", path: [] }
        : { document: null, points: null, problem: "line 1: it is neither YAML nor JSON", path: [] },
    );
  }
  return Response.json({});
}

function open(): void {
  render(
    <MantineProvider>
      <QueryClientProvider client={new QueryClient({ defaultOptions: { queries: { retry: false } } })}>
        <LiveProvider store={new LiveStore(0)}>
          <NewStudy />
        </LiveProvider>
      </QueryClientProvider>
    </MantineProvider>,
  );
}

beforeEach(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  Object.defineProperty(document, "fonts", { value: new EventTarget(), configurable: true });
  vi.stubGlobal(
    "ResizeObserver",
    class {
      observe() {}
      unobserve() {}
      disconnect() {}
    },
  );
  fetched.mockReset().mockImplementation(answer);
});
afterEach(() => {
  cleanup();
  localStorage.clear();
});

const text = () => screen.getByRole<HTMLTextAreaElement>("textbox", { name: TEXTS.text });
const axisBox = (label: string) => `${label} ${fillText(TEXTS.ofAxis, { number: 1 })}`;
const box = (name: string) => screen.getByRole<HTMLInputElement>("textbox", { name });
const change = (element: HTMLElement, value: string) => fireEvent.change(element, { target: { value } });

it("shows the content of the text in the form, and the number of runs", async () => {
  open();
  change(text(), TEXT);
  await waitFor(() => expect(box(axisBox(`${TEXTS.to} [s]`)).value).toBe("1"));
  expect(box(axisBox(`${TEXTS.from} [s]`)).value).toBe("0.4");
  expect(box(axisBox(TEXTS.count)).value).toBe("5");
  const varied = screen.getByRole("combobox", { name: axisBox(TEXTS.parameter) }) as HTMLSelectElement;
  expect(varied.title).toBe(varied.selectedOptions[0]?.textContent); // the box can truncate it
  expect(screen.getByRole("status", { name: "Refusal" }).textContent).toContain("5 runs.");
});

it("writes edits of the form into the text, in SI", async () => {
  open();
  change(text(), TEXT);
  await waitFor(() => expect(box(axisBox(`${TEXTS.to} [s]`)).value).toBe("1"));
  change(box(axisBox(`${TEXTS.to} [s]`)), "0.8");
  expect(text().value).toContain("- {over: lam_q, first: 0.4, last: 0.8, count: 5}");
  fireEvent.click(screen.getByRole("button", { name: TEXTS.addAxis }));
  expect(text().value).toContain("- {over: lam_S, first: 0.4, last: 1, count: 5}");
  fireEvent.click(screen.getByRole("button", { name: TEXTS.addSpread }));
  expect(text().value).toContain("spread:\n  - {of: motor.c0, relative: 0.1}");
  change(box(`${TEXTS.plants} ${TEXTS.toDraw}`), "4");
  expect(text().value).toContain("draws: 4");
  fireEvent.click(screen.getByRole("button", { name: TEXTS.addSetting }));
  change(box(`${TEXTS.value} [°] ${fillText(TEXTS.ofSetting, { number: 1 })}`), "90");
  expect(text().value).toMatch(/settings: \{q_hold: 1\.57079632\d+\}/);
  const axis = within(screen.getByRole("group", { name: fillText(TEXTS.axis, { number: 1 }) }));
  change(axis.getByRole("combobox", { name: axisBox(TEXTS.definition) }), "values");
  change(axis.getByRole("textbox", { name: axisBox(`${TEXTS.values} [s]`) }), "0.4, 0.6,");
  expect(text().value).toContain("- {over: lam_q, values: [0.4, 0.6]}");
  expect(box(axisBox(`${TEXTS.values} [s]`)).value).toBe("0.4, 0.6,"); // the typed text does not change
  fireEvent.click(screen.getByRole("button", { name: fillText(TEXTS.removeAxis, { number: 1 }) }));
  expect(text().value).not.toContain("lam_q");
});

it("shows why a text is not a study, and hides the form", async () => {
  open();
  change(text(), "[");
  await screen.findByText(/neither YAML nor JSON/);
  expect(screen.queryByRole("group", { name: TEXTS.form })).toBeNull();
});

it("is a draft that survives leaving the page; replacing it requires confirmation", async () => {
  open();
  await waitFor(() =>
    expect(fetched.mock.calls.some(([{ url }]) => url.endsWith("/api/session"))).toBe(true),
  );
  fireEvent.click(screen.getByRole("button", { name: TEXTS.createStudy }));
  await waitFor(() => expect(localStorage).toHaveLength(1));
  change(box(TEXTS.studyTitle), "My title");
  cleanup();
  open();
  await waitFor(() => expect(text().value).toContain('title: "My title"'));
  fireEvent.click(screen.getByRole("button", { name: TEXTS.startFromExample }));
  expect(text().value).toContain("My title");
  fireEvent.click(screen.getByRole("button", { name: "Replace draft" }));
  expect(text().value).toContain("lambda_map");
});
