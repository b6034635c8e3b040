import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Refusal } from "../../components/Refusal";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { fillText } from "../../samples/texts";
import type { State } from "../../wire/types";
import { NextMode, nextMode, whyNot } from "./ModeCard";
import { TEXTS } from "./texts";

const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});

const OFF = {
  mode: "off",
  legal_modes: ["pretension"],
  task: null,
  trial: null,
  holder: null,
  unready: "",
} as unknown as State;
const changed = (part: object) => ({ ...OFF, ...part }) as State;

beforeEach(() =>
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} })),
);
afterEach(cleanup);

it("returns the mode to enter first, and null if that mode is illegal or does not help", () => {
  expect(nextMode(null, "start")).toBeNull();
  expect(nextMode(OFF, "start")).toBe("pretension");
  expect(nextMode(changed({ legal_modes: [] }), "start")).toBeNull();
  expect(nextMode(OFF, "off")).toBeNull();
  const held = changed({ mode: "pretension", legal_modes: ["stopping", "run"] });
  expect(nextMode(held, "start")).toBeNull();
  expect(nextMode(held, "off")).toBe("stopping");
  expect(nextMode(changed({ ...held, task: { run: 3 } }), "off")).toBeNull();
  expect(nextMode(changed({ mode: "tripped", legal_modes: [] }), "off")).toBeNull();
});

it("shows a button in the refusal that sends its mode", async () => {
  fetched.mockImplementation(async ({ url }) =>
    new URL(url).pathname === "/api/session"
      ? Response.json({ name: "A. Operator", role: "operator" })
      : Response.json({ epoch: 1, page: "k".repeat(16), name: "A. Operator" }),
  );
  const live = new LiveStore(0);
  live.setState({ ...OFF, link: { starts: 1 } } as unknown as State);
  render(
    <QueryClientProvider client={new QueryClient()}>
      <MantineProvider>
        <LiveProvider store={live}>
          <Refusal text={TEXTS.tendonsSlack}>
            <NextMode need="start" />
          </Refusal>
        </LiveProvider>
      </MantineProvider>
    </QueryClientProvider>,
  );
  fireEvent.click(screen.getByRole("button", { name: TEXTS.pretension }));
  const sent = () => fetched.mock.calls.find(([{ url }]) => new URL(url).pathname === "/api/mode")?.[0];
  await waitFor(() => expect(sent()).toBeDefined());
  expect(await sent()?.clone().json()).toEqual({ mode: "pretension" });
});

describe("whyNot", () => {
  const state = (mode: string, legal_modes: string[]) =>
    ({ mode, legal_modes, pretension_done: true, unready: "" }) as unknown as State;

  it("names modes like their buttons", () => {
    expect(whyNot(state("run", ["pretension", "compliance"]), "run")).toBe(
      fillText(TEXTS.alreadyInMode, { mode: TEXTS.run }),
    );
    expect(whyNot(state("compliance", ["pretension", "run", "stopping"]), "identify")).toBe(
      fillText(TEXTS.modeNotPossible, { mode: TEXTS.compliance, modes: "Pretension, Run, Soft stop" }),
    );
  });

  it("requires a paused sequence of runs to be resumed or stopped first", () => {
    const pretension = state("pretension", ["stopping", "off"]);
    const paused = { ...pretension, task: { phase: "paused" } } as State;
    expect(whyNot(paused, "run")).toBe(TEXTS.runsPaused);
    expect(whyNot(paused, "stopping")).toBeNull();
    expect(whyNot(pretension, "run")).toBe(
      fillText(TEXTS.modeNotPossible, { mode: TEXTS.pretension, modes: "Soft stop, Off" }),
    );
  });

  it("returns the step that pretension requires", () => {
    const off = { ...state("off", []), unready: "set the zero in the bring-up" };
    expect(whyNot(off, "pretension")).toBe("Set the zero in the bring-up.");
    expect(whyNot(off, "run")).toBe("Set the zero in the bring-up.");
    expect(whyNot(off, "stopping")).toBe(
      fillText(TEXTS.modeNotPossible, { mode: TEXTS.off, modes: TEXTS.onlyStop }),
    );
  });
});
