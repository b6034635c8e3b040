/** Pages without a session: the sign-in, and the notice that it requires cookies. */

import { Alert, Box, Button, Paper, PasswordInput, Stack, Text, TextInput, Title } from "@mantine/core";
import { type FormEvent, useState } from "react";
import { fillText } from "../samples/texts";
import { useSignIn } from "../service/api/session";
import { TEXTS } from "./texts";

/** Replaces all pages if the browser blocks cookies, because sign-in requires them. */

export function CookiesBlockedPage() {
  const host = globalThis.location.host;
  return (
    <Box pt="12vh" px="xs">
      <Paper component="main" withBorder maw={480} mx="auto" p="xl">
        <Title order={1} size="h3" mb="md">
          {TEXTS.cookiesBlocked}
        </Title>
        <Text role="alert" style={{ overflowWrap: "anywhere" }}>
          {fillText(TEXTS.cookiesHint, { host })}
        </Text>
      </Paper>
    </Box>
  );
}

/** Sign-in with a token. The page also shows STOP, because an expired session may still send it. */

export function SignInPage() {
  const [token, setToken] = useState("");
  const [name, setName] = useState("");
  const signIn = useSignIn();

  function submit(event: FormEvent): void {
    event.preventDefault();
    signIn.mutate({ token: token.trim(), name: name.trim() });
  }

  return (
    <Box pt="12vh" px="xs">
      <Paper component="main" withBorder maw={420} mx="auto" p="xl">
        <form onSubmit={submit}>
          <Stack gap="md">
            <Title order={1} size="h3">
              {TEXTS.title}
            </Title>
            <Text size="sm" c="dimmed">
              {TEXTS.lead}
            </Text>
            <Text size="sm">{TEXTS.stopHint}</Text>
            <PasswordInput
              label={TEXTS.token}
              required
              withAsterisk={false}
              autoComplete="current-password"
              value={token}
              onChange={(event) => setToken(event.currentTarget.value)}
            />
            <TextInput
              label={TEXTS.name}
              description={TEXTS.nameHint}
              value={name}
              onChange={(event) => setName(event.currentTarget.value)}
            />
            {signIn.error && <Alert color="yellow">{signIn.error.message}</Alert>}
            <Button type="submit" size="sm" loading={signIn.isPending} disabled={token.trim() === ""}>
              {TEXTS.signIn}
            </Button>
          </Stack>
        </form>
      </Paper>
    </Box>
  );
}
