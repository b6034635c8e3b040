/** Brings a bank in from a file that was exported here or elsewhere. */

import { Button, FileButton } from "@mantine/core";
import { IconUpload } from "@tabler/icons-react";
import { useState } from "react";
import { useLocation } from "wouter";
import { useImportBank } from "../../service/commands";
import type { BankFile } from "../../wire/types";
import page from "../Page.module.css";

export function BankImport() {
  const bring = useImportBank();
  const [, go] = useLocation();
  const [problem, setProblem] = useState("");

  async function read(file: File | null): Promise<void> {
    if (file === null) return;
    setProblem("");
    try {
      const document = JSON.parse(await file.text()) as BankFile;
      bring.mutate(document, { onSuccess: (bank) => go(`/banks/${bank.id}`) });
    } catch {
      setProblem(`${file.name} is not JSON.`);
    }
  }

  return (
    <div className={page.actions}>
      <output className={page.dim} aria-label="Import result">
        {problem !== "" ? problem : (bring.error?.message ?? "")}
      </output>
      <FileButton accept="application/json,.json" onChange={read}>
        {(props) => (
          <Button
            {...props}
            variant="default"
            size="compact-sm"
            leftSection={<IconUpload size={14} />}
            loading={bring.isPending}
          >
            Import bank
          </Button>
        )}
      </FileButton>
    </div>
  );
}
