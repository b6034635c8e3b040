// @vitest-environment jsdom
/** Comparison of candidates on one record, and of new parameters with the active ones. */
import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, fireEvent, render, screen, within } from "@testing-library/react";
import type { ReactNode } from "react";
import { afterEach, expect, it, vi } from "vitest";

// the REST client captures fetch when it is created, the charts read the pixel density
vi.hoisted(() => {
  vi.stubGlobal("fetch", () => new Promise(() => {}));
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
});

import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { fillText } from "../../samples/texts";
import { parametersQuery, unseenQuery } from "../../service/api/identifications";
import type { Identification, Parameters, Unseen } from "../../wire/types";
import { ApplyParameters, ParametersCard } from "./ParametersCard";
import { TEXTS } from "./texts";
import { UnseenCard } from "./UnseenCard";

afterEach(() => {
  cleanup();
  localStorage.clear();
});

const CHANGES = [{ name: "K_m", side: "B", unit: "rad/(V·s)", before: 2.86, after: 2.4, percent: -16.0839 }];

function show(children: ReactNode, prepare: (client: QueryClient) => void): void {
  vi.stubGlobal(
    "ResizeObserver",
    class {
      observe() {}
      unobserve() {}
      disconnect() {}
    },
  );
  const client = new QueryClient({ defaultOptions: { queries: { staleTime: Number.POSITIVE_INFINITY } } });
  prepare(client);
  render(
    <LiveProvider store={new LiveStore(0)}>
      <QueryClientProvider client={client}>
        <MantineProvider>{children}</MantineProvider>
      </QueryClientProvider>
    </LiveProvider>,
  );
}

function actuator(run: number, K: number): Identification {
  const model = { K, T: 0.342, K_std: 0.0001, T_std: null, grade: "usable" };
  const parts = {
    id: run,
    run,
    kind: "actuator",
    estimate: run,
    G_q: model,
    G_S: null,
    motors: [],
    springs: [],
  };
  return parts as unknown as Identification;
}

function unseen(run: number, of: number, fit_percent: number): Unseen {
  const stretch = { label: "", t: [13, 14], measured: [0.1, 0.2], predicted: [0.11, 0.19] };
  const output = { name: "G_q", signal: "q", unit: "rad", fit_percent, rms: 0.01, samples: 2, problem: "" };
  return { run, of, own: run === of, kind: "actuator", outputs: [{ ...output, stretches: [stretch] }] };
}

function rows(label: string): string[][] {
  const table = screen.getByRole("table", { name: label });
  return within(table)
    .getAllByRole("row")
    .slice(1)
    .map((row) =>
      within(row)
        .getAllByRole("cell")
        .map((cell) => cell.textContent ?? ""),
    );
}

it("compares candidates on one record, with their differences from the first", () => {
  const [first, other] = [actuator(7, 0.05), actuator(5, 0.0525)];
  show(<UnseenCard identification={first} all={[first, other]} />, (client) => {
    client.setQueryData(unseenQuery(7, 7).queryKey, unseen(7, 7, 96.5));
    client.setQueryData(unseenQuery(5, 7).queryKey, unseen(5, 7, 91.25));
    client.setQueryData(unseenQuery(7, 5).queryKey, unseen(7, 5, 88));
    client.setQueryData(unseenQuery(5, 5).queryKey, unseen(5, 5, 97));
  });
  expect(rows(fillText(TEXTS.comparedModels, { title: "G_q" })).map((row) => row[0])).toEqual(["7"]);
  fireEvent.click(screen.getByRole("checkbox", { name: fillText(TEXTS.compareRun, { run: 5 }) }));
  const [own, compared] = rows(fillText(TEXTS.comparedModels, { title: "G_q" }));
  expect(own).toEqual(["7", "0.05000 ± 0.00010", "0.3420 ± –", "96.50", "0.573", "usable"]);
  expect(compared).toEqual(["5", "0.05250 ± 0.00010+5.0 %", "0.3420 ± –0.0 %", "91.25", "0.573", "usable"]);
  expect(document.body.textContent?.includes(fillText(TEXTS.ownThird, { run: 7 }))).toBeTruthy();
  fireEvent.change(screen.getByRole("combobox", { name: TEXTS.validationData }), { target: { value: "5" } });
  expect(rows(fillText(TEXTS.comparedModels, { title: "G_q" })).map((row) => row[3])).toEqual([
    "88.00",
    "97.00",
  ]);
});

it("shows the changes of parameters, or why they cannot be applied", () => {
  const proposal = { estimate: 3, problem: "", digest: "ab", changes: CHANGES };
  const parameters: Parameters = { name: "lab", versions: [], proposal };
  show(<ApplyParameters estimate={3} />, (client) =>
    client.setQueryData(parametersQuery(3).queryKey, parameters),
  );
  expect(rows(TEXTS.proposedChanges)).toEqual([
    [`Km ${fillText(TEXTS.ofMotor, { side: "B" })}`, "2.8600", "2.4000", "rad/(V·s)", "−16.08"],
  ]);
  expect(screen.getByRole("button", { name: TEXTS.applyParameters })).toBeTruthy();
  cleanup();
  const refused = { ...proposal, problem: "run 3 is not usable: hardly moved", changes: [] };
  show(<ApplyParameters estimate={3} />, (client) =>
    client.setQueryData(parametersQuery(3).queryKey, { ...parameters, proposal: refused }),
  );
  expect(screen.getByText(fillText(TEXTS.problem, { problem: refused.problem }))).toBeTruthy();
  expect(screen.queryByRole("button", { name: /^(?!STOP)/ })).toBeNull();
});

it("lists the versions with person, time and source, and undoes the newest", () => {
  const file = {
    number: 0,
    digest: "0".repeat(64),
    who: "",
    at: null,
    estimate: null,
    run: null,
    undone: false,
  };
  const applied = {
    number: 1,
    digest: "1".repeat(64),
    who: "Ana",
    at: "2026-03-31T10:00:00Z",
    estimate: 3,
    run: 8,
  };
  const versions = [
    { ...applied, undone: false, changes: CHANGES },
    { ...file, changes: [] },
  ];
  show(<ParametersCard />, (client) =>
    client.setQueryData(parametersQuery(null).queryKey, { name: "lab", versions, proposal: null }),
  );
  const shown = rows(TEXTS.versions).map((row) => [row[0], row[2], row[3], row[4]]);
  expect(shown).toEqual([
    ["1", "Ana", fillText(TEXTS.runLink, { run: 8 }), "111111111111"],
    ["0", "–", TEXTS.parameterFile, "000000000000"],
  ]);
  expect(screen.getByRole("button", { name: fillText(TEXTS.undo, { version: 1 }) })).toBeTruthy();
});
