/** A number of a form. Text that is no number stays as it is, marked, and is handed on as text: no form sends it. */

import { TextInput, type TextInputProps } from "@mantine/core";
import { useRef, useState } from "react";
import { notANumber } from "../samples/number";
import { boxText, inSI } from "../samples/quantity";
import { useAngles } from "../service/angles";
import type { Entry } from "../service/glossary";
import { useRefusedInput } from "../service/refusedFields";
import { useDescribedBy } from "../service/useDescribedBy";
import { help } from "./help";

interface NumberFieldProps
  extends Pick<
    TextInputProps,
    "name" | "label" | "aria-label" | "description" | "disabled" | "size" | "w" | "styles"
  > {
  /** In SI; typed and shown as the person reads that unit. */
  readonly value: number | string;
  readonly unit?: string;
  /** Where the value stands in what is sent, as refusals name it; the name of the box if left out. */
  readonly place?: string;
  /** Where there is no room below the box: the element that says why it is refused, or no number. */
  readonly saidAt?: string;
  /** What it is for. */
  readonly entry?: Entry | undefined;
  onChange(value: number | string): void;
}

export function NumberField(props: NumberFieldProps) {
  const { value, unit = "1", place = props.name, saidAt, entry, onChange, ...rest } = props;
  const { onFocus, onBlur, ...helped } = help(entry);
  const angles = useAngles();
  const [typed, setTyped] = useState<string | null>(null);
  const before = useRef(value);
  const { ref, said } = useRefusedInput<HTMLInputElement>(rest.disabled ? undefined : place, saidAt);
  const odd = typeof value === "string" && !rest.disabled ? notANumber(value) : null;
  useDescribedBy(ref, odd === null ? undefined : saidAt);
  const problem = odd ?? said;
  // while "1." is being typed it is the number 1, and its point stays
  const mine = typed !== null && (inSI(typed, unit, angles) ?? typed) === value;
  return (
    <TextInput
      {...rest}
      {...helped}
      autoComplete="off"
      inputWrapperOrder={["label", "input", "description", "error"]}
      value={mine ? typed : typeof value === "number" ? boxText(value, unit, angles) : value}
      ref={ref}
      error={saidAt === undefined ? problem : problem !== null}
      onFocus={(event) => {
        before.current = value;
        onFocus?.(event);
      }}
      onChange={(event) => {
        const text = event.currentTarget.value;
        setTyped(text);
        onChange(inSI(text, unit, angles) ?? text);
      }}
      onBlur={(event) => {
        setTyped(null);
        onBlur?.(event);
      }}
      onKeyDown={(event) => {
        if (event.key !== "Escape") return;
        setTyped(null);
        onChange(before.current);
      }}
    />
  );
}
