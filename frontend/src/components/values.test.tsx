import { cleanup, render, screen } from "@testing-library/react";
import { afterEach, describe, expect, it } from "vitest";
import { SymbolText, ValueOrReason, writeAbsent, writeValue } from "./values";

/** A missing value always has a reason: types enforce it for numbers, and a search of the source for the rest. */
describe("absent", () => {
  afterEach(cleanup);

  const SOURCES = import.meta.glob<string>("../**/*.{ts,tsx}", {
    query: "?raw",
    import: "default",
    eager: true,
  });
  /** A text that is only a dash, and a table cell without content. */
  const BARE = [
    /(["'`])\s*[–—]\s*\1/,
    />\s*[–—-]\s*</,
    /^\s*[–—-]\s*$/m,
    /(?::|\?\?|\|\|) ""\}\s*<\/(?:Table\.T[dh]|t[dh]|dd)>/,
  ];

  function bareIn(source: string): string | undefined {
    const code = source.replace(/\/\*[\s\S]*?\*\/|\/\/.*/g, "");
    return BARE.map((pattern) => pattern.exec(code)?.[0]).find((found) => found !== undefined);
  }

  describe("the source", () => {
    it.each([
      'const none = "–";',
      "return `—`;",
      "<td>–</td>",
      "<span>\n    –\n  </span>",
      "<dd>-</dd>",
      '<td>{value === null ? "" : value}</td>'.replace('? "" : value', '? value : ""'),
      '<Table.Td className={page.number}>{name ?? ""}</Table.Td>',
    ])("is found in %j", (source) => {
      expect(bareIn(source)).toBeDefined();
    });

    it("has no dash and no empty cell without a reason", () => {
      const files = Object.entries(SOURCES).filter(([path]) => !/\.test\.|\/wire\//.test(path));
      expect(files.length).toBeGreaterThan(150);
      const bare = files.filter(([, source]) => bareIn(source) !== undefined).map(([path]) => path);
      expect(bare).toEqual(["./values.tsx"]);
    });
  });

  it.each([null, undefined, Number.NaN])("shows the reason for %s, also to screen readers", (value) => {
    render(
      <ValueOrReason value={value} why="nothing is staged">
        {(some) => `${some} s`}
      </ValueOrReason>,
    );
    const dash = screen.getByRole("img", { name: "nothing is staged" });
    expect([dash.textContent, dash.title]).toEqual(["–", "nothing is staged"]);
    expect(document.body.textContent).toBe("–");
  });

  it.each([0, false, ""])("shows %j as a value", (value) => {
    render(
      <ValueOrReason<unknown> value={value} why="no">
        {(some) => `has ${some}`}
      </ValueOrReason>,
    );
    expect(document.body.textContent).toBe(`has ${value}`);
  });

  it("writes the reason into the page and removes it with the next value", () => {
    const place = document.body.appendChild(document.createElement("span"));
    writeAbsent(place, "no sample");
    writeAbsent(place, "none in force");
    expect(screen.getByRole("img", { name: "none in force" }).title).toBe("none in force");
    writeValue(place, "1.25");
    expect(place.outerHTML).toBe("<span>1.25</span>");
    place.remove();
  });
});

describe("signal name", () => {
  it.each([
    ["theta_A_ref", "θA,ref"],
    ["lam_q", "λq"],
    ["q_ref", "qref"],
    ["F_A", "FA"],
    ["theta_A - theta_A_ref", "θA − θA,ref"],
  ])("writes %s in the paper's notation", (name, read) => {
    const { container } = render(<SymbolText name={name} />);
    expect(container.textContent).toBe(read);
  });
});
