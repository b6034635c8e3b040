/** Texts with fields. Each page has its texts in one catalogue, `texts.ts`, by name. */

type Fields<Text extends string> = Text extends `${string}{${infer Name}}${infer Rest}`
  ? Name | Fields<Rest>
  : never;

/**
 * Inserts fields into a text: `fillText("Run {run}", { run: 12 })` is "Run 12". Values are inserted unchanged: braces
 * in a person's text remain, and quantities need their unit (`formatWithUnit`).
 */
export function fillText<const Text extends string>(
  text: Text,
  fields: Readonly<Record<Fields<Text>, string | number>>,
): string {
  const values = fields as Readonly<Record<string, string | number>>;
  return text.replace(/\{(\w+)\}/g, (_, name: string) => String(values[name]));
}

/** Returns a count with its noun: "1 run", "3 runs". */
export function countThings(count: number, thing: string, things = `${thing}s`): string {
  return `${count} ${count === 1 ? thing : things}`;
}
