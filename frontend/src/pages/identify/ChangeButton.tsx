/** A button that changes the parameters in force, and why it cannot at present. */

import { Button } from "@mantine/core";
import { useId } from "react";
import { Refusal } from "../../components/Refusal";
import { useLive } from "../../live/react";
import { useMayCommand } from "../../service/useMayCommand";
import { useNoControl } from "../../service/useNoControl";
import { NextMode } from "../operate/NextMode";
import styles from "./Identify.module.css";

interface ChangeButtonProps {
  readonly children: string;
  readonly error: Error | null;
  readonly pending: boolean;
  /** What the refused request would have changed. */
  readonly about: unknown;
  onPress(): void;
}

export function ChangeButton({ children, error, pending, about, onPress }: ChangeButtonProps) {
  const may = useMayCommand();
  const mode = useLive((live) => live.state?.mode);
  const id = useId();
  const noControl = useNoControl();
  const reason =
    may === false
      ? "Operators change the parameters."
      : (noControl ??
        (mode === "off" || mode === undefined
          ? null
          : `Parameters change in off only; the mode is ${mode}: switch it off first.`));
  return (
    <>
      <Button
        variant="default"
        className={styles.act}
        aria-disabled={reason !== null}
        data-disabled={reason !== null || undefined}
        aria-describedby={id}
        loading={pending}
        onClick={() => reason === null && onPress()}
      >
        {children}
      </Button>
      <Refusal id={id} error={error} about={`${mode} ${about}`} text={reason}>
        <NextMode need="off" />
      </Refusal>
    </>
  );
}
