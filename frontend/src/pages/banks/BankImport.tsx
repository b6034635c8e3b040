/** Brings a bank in from a file that was exported here or elsewhere. */

import { Button, FileButton } from "@mantine/core";
import { useState } from "react";
import { TbUpload } from "react-icons/tb";
import { useLocation } from "wouter";
import { Refusal } from "../../components/Refusal";
import { useImportBank } from "../../service/commands";
import { RefusedFields, useRefusedInput } from "../../service/refusedFields";
import { useDescribedBy } from "../../service/useDescribedBy";
import type { BankFile } from "../../wire/types";
import page from "../Page.module.css";

const SAID_AT = "refusal-of-bank-file";

export function BankImport() {
  const bring = useImportBank();
  const [, go] = useLocation();
  const [problem, setProblem] = useState<string | null>(null);
  const error = problem === null ? bring.error : null;

  async function read(file: File | null): Promise<void> {
    if (file === null) return;
    setProblem(null);
    try {
      const document = JSON.parse(await file.text()) as BankFile;
      bring.mutate(document, { onSuccess: (bank) => go(`/banks/${bank.id}`) });
    } catch {
      setProblem(`${file.name} is not JSON: choose a file that was exported from a bank.`);
    }
  }

  return (
    <RefusedFields error={error} only="file">
      <div className={page.actions}>
        <Refusal id={SAID_AT} error={error} text={problem} forFields />
        <FileChoice reading={bring.isPending} odd={problem !== null} onChange={read} />
      </div>
    </RefusedFields>
  );
}

interface FileChoiceProps {
  readonly reading: boolean;
  /** Whether the file that was chosen is none. */
  readonly odd: boolean;
  onChange(file: File | null): void;
}

function FileChoice({ reading, odd, onChange }: FileChoiceProps) {
  const { ref, said } = useRefusedInput<HTMLButtonElement>("file", SAID_AT);
  useDescribedBy(ref, odd ? SAID_AT : undefined);
  const refused = odd || said !== null;
  return (
    <FileButton accept="application/json,.json" onChange={onChange}>
      {(props) => (
        <Button
          {...props}
          ref={ref}
          variant="default"
          style={refused ? { borderColor: "var(--warn-text)", color: "var(--warn-text)" } : undefined}
          data-refused={refused}
          size="compact-sm"
          leftSection={<TbUpload size={14} />}
          loading={reading}
        >
          Import bank
        </Button>
      )}
    </FileButton>
  );
}
