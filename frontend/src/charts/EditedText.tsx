/** A text that is taken when it is left or with Enter; Escape brings the one before back. */

import { TextInput } from "@mantine/core";
import { useEffect, useState } from "react";

interface EditedTextProps {
  readonly label: string;
  readonly text: string;
  onDone(text: string): void;
}

export function EditedText({ label, text, onDone }: EditedTextProps) {
  const [typed, type] = useState(text);
  useEffect(() => type(text), [text]);
  const done = () => {
    if (typed !== text) onDone(typed);
  };
  return (
    <TextInput
      aria-label={label}
      value={typed}
      maxLength={40}
      w={170}
      onChange={(event) => type(event.currentTarget.value)}
      onBlur={done}
      onKeyDown={(event) => {
        if (event.key === "Enter") done();
        if (event.key === "Escape") type(text);
      }}
    />
  );
}
