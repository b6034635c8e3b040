/** A number of a form. Text that is no number stays as it is, marked, and is handed on as text: no form sends it. */

import { TextInput, type TextInputProps } from "@mantine/core";
import { useRef, useState } from "react";
import { notANumber, numberIn } from "../samples/number";

interface NumberFieldProps
  extends Pick<
    TextInputProps,
    "label" | "aria-label" | "description" | "disabled" | "size" | "w" | "styles"
  > {
  readonly value: number | string;
  onChange(value: number | string): void;
}

export function NumberField({ value, onChange, ...rest }: NumberFieldProps) {
  const [typed, setTyped] = useState<string | null>(null);
  const before = useRef(value);
  // while "1." is being typed it is the number 1, and its point stays
  const mine = typed !== null && (numberIn(typed) ?? typed) === value;
  return (
    <TextInput
      {...rest}
      autoComplete="off"
      inputWrapperOrder={["label", "input", "description", "error"]}
      value={mine ? typed : String(value)}
      error={typeof value === "string" && !rest.disabled ? notANumber(value) : undefined}
      onFocus={() => {
        before.current = value;
      }}
      onChange={(event) => {
        const text = event.currentTarget.value;
        setTyped(text);
        onChange(numberIn(text) ?? text);
      }}
      onBlur={() => setTyped(null)}
      onKeyDown={(event) => {
        if (event.key !== "Escape") return;
        setTyped(null);
        onChange(before.current);
      }}
    />
  );
}
