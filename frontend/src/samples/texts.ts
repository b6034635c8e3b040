/** Texts of the page with fields: each page has its texts in one catalogue, `texts.ts`, by name. */

type Fields<Text extends string> = Text extends `${string}{${infer Name}}${infer Rest}`
  ? Name | Fields<Rest>
  : never;

/**
 * A text with its fields filled in: `fillText("Run {run}", { run: 12 })` is "Run 12". A field's value is inserted as it
 * is: a person's text with braces stays, and quantities come with their unit (`formatWithUnit`).
 */
export function fillText<const Text extends string>(
  text: Text,
  fields: Readonly<Record<Fields<Text>, string | number>>,
): string {
  const values = fields as Readonly<Record<string, string | number>>;
  return text.replace(/\{(\w+)\}/g, (_, name: string) => String(values[name]));
}

/** A number of things: "1 run", "3 runs". */
export function countThings(count: number, thing: string, things = `${thing}s`): string {
  return `${count} ${count === 1 ? thing : things}`;
}
