// @vitest-environment jsdom
/** A form with a draft: the draft survives leaving and a reload, is marked, and is discarded only after a question. */
import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, fireEvent, render, screen } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { sessionQuery } from "../service/api/session";
import { isText, useDraft } from "../service/forms/drafts";
import { DraftMark, useReplaceDraft } from "./DraftMark";

beforeEach(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
});
afterEach(() => {
  cleanup();
  localStorage.clear();
});

function Form() {
  const draft = useDraft("test", "saved", isText);
  const [guard, question] = useReplaceDraft(draft.since !== null);
  return (
    <>
      <input
        aria-label="Text"
        value={draft.value}
        onChange={(event) => draft.set(event.currentTarget.value)}
      />
      <button type="button" onClick={() => guard(() => draft.set("example"))}>
        Example
      </button>
      {question}
      <DraftMark draft={draft} of="test" back="The saved text comes back." onDiscard={draft.discard} />
    </>
  );
}

function open(person: string): void {
  const queries = new QueryClient({ defaultOptions: { queries: { staleTime: Number.POSITIVE_INFINITY } } });
  queries.setQueryData(sessionQuery.queryKey, { name: person, role: "operator" } as never);
  render(
    <QueryClientProvider client={queries}>
      <MantineProvider>
        <Form />
      </MantineProvider>
    </QueryClientProvider>,
  );
}

const box = () => screen.getByRole<HTMLInputElement>("textbox", { name: "Text" });
const type = (value: string) => fireEvent.change(box(), { target: { value } });
const press = (name: string) => fireEvent.click(screen.getByRole("button", { name }));
const mark = () => screen.queryByRole("group", { name: "Draft of the test" });

it("survives leaving the page, is marked, and belongs to one person", () => {
  open("Mara");
  expect(mark()).toBeNull();
  type("typed");
  expect(mark()?.textContent).toMatch(/^Unsaved draft, since \d{4}-\d\d-\d\d \d\d:\d\d:\d\d\./);
  cleanup();
  open("Vera");
  expect(box().value).toBe("saved");
  cleanup();
  open("Mara");
  expect(box().value).toBe("typed");
  expect(mark()).not.toBeNull();
});

it("is no draft once it equals the saved values", () => {
  open("Mara");
  type("typed");
  type("saved");
  expect(mark()).toBeNull();
  expect(localStorage).toHaveLength(0);
});

it("is discarded only after a question", () => {
  open("Mara");
  type("typed");
  press("Discard the draft of the test");
  press("Keep draft");
  expect(box().value).toBe("typed");
  press("Discard the draft of the test");
  press("Discard draft");
  expect(box().value).toBe("saved");
  expect(mark()).toBeNull();
});

it("asks before other content replaces it, and only then", () => {
  open("Mara");
  press("Example");
  expect(box().value).toBe("example");
  press("Example");
  press("Keep draft");
  type("typed");
  press("Example");
  expect(box().value).toBe("typed");
  expect(screen.getByRole("alertdialog", { name: "Replace the draft" })).toBeTruthy();
  press("Replace draft");
  expect(box().value).toBe("example");
  expect(screen.queryByRole("alertdialog")).toBeNull();
});

it("ignores stored data of another kind", () => {
  open("Mara");
  type("typed");
  const key = localStorage.key(0) ?? "";
  localStorage.setItem(key, (localStorage.getItem(key) ?? "").replace('"typed"', "17"));
  cleanup();
  open("Mara");
  expect(box().value).toBe("saved");
  expect(mark()).toBeNull();
});
